#version 460
#extension GL_GOOGLE_include_directive : require
// Camera: one ray per pixel and sample; emission and all orders of scattered light, attenuated on their way to the eye,
// plus what lies behind. Order 1 of delta lights is not read from the volume but computed here, at one point per sample
// drawn in proportion to what the eye sees of the medium: with it shadows have no voxel steps, the phase function is the
// true one, and the mean over the samples is unbiased.
// Grid: x, y = pixels of a band of rows.
#define ENVIRONMENT_BINDING 3
#define LIGHTS_BINDING 7
#define SCATTERING_BINDING 6
#define SCENE_COPIED
#include "include/opacity.glsl"
#include "include/march.glsl"
#include "include/rng.glsl"
#include "include/delta_lights.glsl"
#include "include/environment.glsl"
#include "include/scattering.glsl"

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

// Part of a ray's step: where the step begins, how long it is, and which share of its optical depth is meant.
struct PartOfStep {
    float begin;
    float stride;
    float share;
};

// The step in which the depth along `ray` meets `target`, with a first step of `stride`.
PartOfStep step_of_depth(Ray ray, float stride, float target) {
    PartOfStep found = PartOfStep(0.0, 0.0, 0.0);
    float before = 0.0;
    float t = 0.0;
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
            found = PartOfStep(t, stride, min((target - before) / tau, 1.0));
        }
        before += tau;
        t += stride + (steps_ahead(ray, p) - 1.0) * ray.dt;
        stride = ray.dt;
    }
    return found;
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
    // Delta lights are seen where the eye has seen the share `u` of what it sees of the medium. Of a medium that hides what is behind it
    // that is all there is, and the step is found on the way.
    float u = on_lattice(depth_stride, random_float(key, 3u));
    float target = optical_depth_of_opacity(u);
    PartOfStep lit = PartOfStep(0.0, 0.0, 0.0);
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
        float before = depth;
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
        if (LIT && before <= target && depth > target) {
            lit = PartOfStep(t, stride, (target - before) / (depth - before));
        }
        t += stride + (steps_ahead(ray, p) - 1.0) * ray.dt;
        stride = ray.dt;
    }
    // What is stored overshoots a little beside sharp edges, and two moments may leave less than nothing; light is never negative.
    radiance = max(radiance / scene.radiance_scale, 0.0);
    // Not 1 − `through`, which forgets thin media.
    float opacity = opacity_of_depth(depth);
    if (LIT && depth > 0.0) {
        bool is_opaque = opacity > OPAQUE;
        if (!is_opaque || depth <= target) {
            // The same march again. The few samples that would be seen behind an opaque medium are spread over it again, evenly.
            float of_opacity = is_opaque ? max(u - opacity, 0.0) / (1.0 - opacity) : u;
            lit = step_of_depth(ray, start * ray.dt, optical_depth_of_opacity(of_opacity * opacity));
        }
        float at = lit.begin + lit.stride * place_of_depth(extinction, ray, lit.begin, lit.stride, lit.share);
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
