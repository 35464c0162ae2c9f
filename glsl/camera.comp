#version 460
#extension GL_GOOGLE_include_directive : require
// Camera: one ray per pixel and sample; emission and all orders of scattered light, attenuated on their way to the eye,
// plus what lies behind. Order 1 of delta lights is not read from the volume but computed here, at one point per sample
// drawn in proportion to what the eye sees of the medium: with it shadows have no voxel steps, the phase function is the
// true one, and the mean over the samples is unbiased.
// Grid: x, y = pixels of a band of rows.
#define ENVIRONMENT_BINDING 3
#define LIGHTS_BINDING 7
#define SCENE_COPIED
#include "include/transfer.glsl"
#include "include/march.glsl"
#include "include/rng.glsl"
#include "include/delta_lights.glsl"
#include "include/environment.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

// Delta lights are seen by single scattering.
layout(constant_id = 5) const bool LIT = false;
// What is behind the medium.
layout(constant_id = 4) const uint BACKGROUND = BACKGROUND_TRANSPARENT;

// The source towards the eye is extinction times rgb, as the projection stores it, plus `emitted`; else rgb itself.
layout(constant_id = 6) const bool PROJECTED = false;
// Something in the medium emits.
layout(constant_id = 7) const bool EMITS = false;
// The light is stored for every eye, as A and B (project_deposit.comp).
layout(constant_id = 9) const bool DIRECTED = false;

// rgb = light for this eye, or A; a = extinction.
layout(set = 0, binding = 5) uniform sampler3D total;
// a = extinction; the rest is for those who read nothing else.
layout(set = 0, binding = 12) uniform sampler3D extinction;
// rgb = B by component.
layout(set = 0, binding = 9) uniform sampler3D total_x;
layout(set = 0, binding = 10) uniform sampler3D total_y;
layout(set = 0, binding = 11) uniform sampler3D total_z;
// rgb = emitted source.
layout(set = 0, binding = 8) uniform sampler3D emitted;
layout(set = 0, binding = 6) uniform sampler3D scalar;
// Mean over the samples so far, times samples: radiance premultiplied by alpha, and alpha.
layout(set = 0, binding = 4, rgba32f) uniform image2D picture;

layout(push_constant, scalar) uniform CameraPush {
    uint row_begin;
    uint row_end;
    uint sample_index;
    uint samples;
    float step_voxels;
    // Delta lights, how many of them a sample visits, and the step towards them.
    uint light_count;
    uint lights_per_sample;
    float light_step;
    // The samples' lattice: strides along y, depth and first step where that along x is 1, coprime to `samples`.
    uint y_stride;
    uint depth_stride;
    uint start_stride;
};

// Albedo at `p` (index space): σ_s and σ_t interpolated, then divided (DESIGN section 1).
vec3 albedo_at(vec3 p) {
    vec3 corner = p - 0.5;
    ivec3 low = ivec3(floor(corner));
    vec3 f = corner - vec3(low);
    vec3 scattering = vec3(0.0);
    float sum = 0.0;
    for (uint n = 0u; n < 8u; n++) {
        ivec3 offset = ivec3(n & 1u, n >> 1u & 1u, n >> 2u);
        vec3 w = mix(1.0 - f, f, equal(offset, ivec3(1)));
        ivec3 voxel = clamp(low + offset, ivec3(0), ivec3(scene.dims) - 1);
        Material m = classify(texelFetch(scalar, voxel, 0).r);
        scattering += (w.x * w.y * w.z * m.extinction) * albedo_of(m);
        sum += w.x * w.y * w.z * m.extinction;
    }
    return sum > 0.0 ? scattering / sum : vec3(0.0);
}

// Radiance that delta lights send towards the eye by one scattering at `p`, times `seen`.
vec3 lit_radiance(vec3 p, vec3 to_eye, float seen, uint key) {
    vec3 world = world_from_index(p);
    vec3 sum = vec3(0.0);
    // Where there are more lights than a sample may visit, it visits evenly spread ones from a random start.
    uint first = uint(random_float(key, 4u + sample_index) * float(light_count));
    for (uint i = 0u; i < lights_per_sample; i++) {
        uint l = (first + i * light_count / lights_per_sample) % light_count;
        LightArrival light = light_at(lights[l], world);
        float t = transmittance(extinction, make_ray(p, -light.travel, float(STEP_SAMPLES) * light_step), light.reach);
        sum += light.irradiance * (t * phase_hg(scene.g, dot(light.travel, to_eye)));
    }
    return albedo_at(p) * sum * (seen * float(light_count) / float(lights_per_sample));
}

// This sample's coordinate on the lattice, shifted around the unit circle.
float on_lattice(uint stride, float shift) {
    return fract(float(sample_index * stride % samples) / float(samples) + shift);
}

void main() {
    scene = scene_in_memory;
    uvec2 pixel = uvec2(gl_GlobalInvocationID.x, row_begin + gl_GlobalInvocationID.y);
    if (pixel.x >= scene.size.x || pixel.y >= row_end) {
        return;
    }
    uint key = stream_key(pixel.y * scene.size.x + pixel.x, 0x43414D45u, scene.seed_low, scene.seed_high);
    // Box filter: a lattice over the pixel's area, shifted at random per pixel; one sample goes through the centre.
    vec2 place = vec2(0.5);
    float start = 1.0;
    if (samples > 1u) {
        place = vec2(on_lattice(1u, random_float(key, 0u)), on_lattice(y_stride, random_float(key, 1u)));
        start = 1.0 - on_lattice(start_stride, random_float(key, 2u));
    }
    vec3 direction = eye_direction((vec2(pixel) + place) / vec2(scene.size));
    Ray ray = make_eye_ray(direction, float(STEP_SAMPLES) * step_voxels);
    float through = 1.0;
    float depth = 0.0;
    vec3 radiance = vec3(0.0);
    float t = 0.0;
    // The first step is shortened at random: steps of one length everywhere show as bands.
    float stride = start * ray.dt;
    // The host keeps the steps of the longest ray within MAX_ITERATIONS.
    while (t < ray.end && through > LEAST_TRANSMITTANCE) {
        stride = min(stride, ray.end - t);
        float scale = scene.max_extinction * 0.5 * stride;
        vec3 p;
        vec4 found[STEP_SAMPLES];
        vec3 glow[STEP_SAMPLES];
        for (uint k = 0u; k < STEP_SAMPLES; k++) {
            p = ray.origin + ray.direction * (t + GAUSS[k] * stride);
            vec3 uvw = p / vec3(scene.dims);
            vec4 f = textureLod(total, uvw, 0.0);
            if (DIRECTED) {
                f.rgb -= textureLod(total_x, uvw, 0.0).rgb * direction.x + textureLod(total_y, uvw, 0.0).rgb * direction.y
                    + textureLod(total_z, uvw, 0.0).rgb * direction.z;
            }
            found[k] = f;
            if (EMITS) {
                glow[k] = textureLod(emitted, uvw, 0.0).rgb;
            }
        }
        for (uint k = 0u; k < STEP_SAMPLES; k++) {
            float tau = found[k].a * scale;
            float passed = exp(-tau);
            vec3 source = found[k].rgb;
            if (PROJECTED) {
                // The stored light runs straight through both samples, and is that of where the half is seen in the mean: in dense
                // media at its near end.
                float along = (0.5 * (float(k) + mean_place(tau, passed)) - GAUSS[0]) / (GAUSS[1] - GAUSS[0]);
                source = found[k].a * mix(found[0].rgb, found[1].rgb, along);
            }
            if (EMITS) {
                source += glow[k];
            }
            radiance += source * (through * scale * mean_transmittance(tau, passed));
            through *= passed;
            depth += tau;
        }
        t += stride + (steps_ahead(ray, p) - 1.0) * ray.dt;
        stride = ray.dt;
    }
    // What is stored overshoots a little beside sharp edges, and two moments may leave less than nothing; light is never negative.
    radiance = max(radiance / scene.radiance_scale, 0.0);
    // Not 1 − `through`, which forgets thin media.
    float opacity = opacity_of_depth(depth);
    if (LIT && depth > 0.0) {
        // The same march again, up to the depth at which the eye has seen the share `u` of what it sees of the medium.
        float u = on_lattice(depth_stride, random_float(key, 3u));
        float target = optical_depth_of_opacity(u * opacity);
        float before = 0.0;
        // The step in which the depth meets the target, and which share of its depth that takes.
        float begin = 0.0;
        float part = 0.0;
        float share = 0.0;
        t = 0.0;
        stride = start * ray.dt;
        while (t < ray.end && before < target) {
            stride = min(stride, ray.end - t);
            vec3 p;
            float sigma = 0.0;
            for (uint k = 0u; k < STEP_SAMPLES; k++) {
                p = ray.origin + ray.direction * (t + GAUSS[k] * stride);
                sigma += textureLod(extinction, p / vec3(scene.dims), 0.0).a;
            }
            float tau = sigma * scene.max_extinction * 0.5 * stride;
            if (tau > 0.0) {
                begin = t;
                part = stride;
                share = min((target - before) / tau, 1.0);
            }
            before += tau;
            t += stride + (steps_ahead(ray, p) - 1.0) * ray.dt;
            stride = ray.dt;
        }
        float at = begin + part * place_of_depth(extinction, ray, begin, part, share);
        radiance += lit_radiance(ray.origin + ray.direction * at, -direction, opacity, key);
    }
    float alpha = 1.0;
    if (BACKGROUND == BACKGROUND_TRANSPARENT) {
        alpha = opacity;
    } else if (BACKGROUND == BACKGROUND_COLOR) {
        radiance += through * scene.background;
    } else if (ENVIRONMENT != ENVIRONMENT_NONE) {
        radiance += through * environment_radiance(direction);
    }
    vec4 old = sample_index == 0u ? vec4(0.0) : imageLoad(picture, ivec2(pixel));
    imageStore(picture, ivec2(pixel), old + vec4(radiance, alpha) / float(samples));
}
