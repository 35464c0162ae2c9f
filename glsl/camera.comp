#version 460
#extension GL_GOOGLE_include_directive : require
// Camera: one ray per pixel and sample; emission and all orders of scattered light, attenuated on their way to the eye,
// plus what lies behind.
// Grid: x, y = pixels of a band of rows.
#define ENVIRONMENT_BINDING 3
#include "include/march.glsl"
#include "include/rng.glsl"
#include "include/environment.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

// What is behind the medium.
layout(constant_id = 4) const uint BACKGROUND = BACKGROUND_TRANSPARENT;

// rgb = source towards the eye, a = extinction.
layout(set = 0, binding = 1) uniform sampler3D total;
// Mean over the samples so far, times samples: radiance premultiplied by alpha, and alpha.
layout(set = 0, binding = 4, rgba32f) uniform image2D picture;

layout(push_constant, scalar) uniform CameraPush {
    uint row_begin;
    uint row_end;
    uint sample_index;
    uint samples;
    float step_voxels;
};

void main() {
    uvec2 pixel = uvec2(gl_GlobalInvocationID.x, row_begin + gl_GlobalInvocationID.y);
    if (pixel.x >= scene.size.x || pixel.y >= row_end) {
        return;
    }
    uint key = stream_key(pixel.y * scene.size.x + pixel.x, 0x43414D45u, scene.seed_low, scene.seed_high);
    // Box filter: a lattice over the pixel's area, shifted at random per pixel; one sample goes through the centre.
    vec2 place = vec2(0.5);
    float start = 1.0;
    if (samples > 1u) {
        float i = float(sample_index);
        place = fract(vec2((i + 0.5) / float(samples), i * 0.61803398875) + vec2(random_float(key, 0u), random_float(key, 1u)));
        start = 1.0 - fract(i * 0.41421356237 + random_float(key, 2u));
    }
    vec2 film = (vec2(pixel) + place) / vec2(scene.size) * 2.0 - 1.0;
    vec3 direction = normalize(scene.forward + film.x * scene.right - film.y * scene.up);

    Ray ray = make_ray(index_from_world(scene.eye), direction, step_voxels);
    // Count from where the volume begins: a far eye leaves few digits.
    ray.origin += ray.direction * ray.begin;
    ray.end -= ray.begin;
    float through = 1.0;
    vec3 radiance = vec3(0.0);
    float t = 0.0;
    // The first step is shortened at random: steps of one length everywhere show as bands.
    float stride = start * ray.dt;
    // The host keeps the steps of the longest ray within MAX_ITERATIONS.
    while (t < ray.end && through > LEAST_TRANSMITTANCE) {
        stride = min(stride, ray.end - t);
        vec3 p = ray.origin + ray.direction * (t + 0.5 * stride);
        float scale = scene.max_extinction * stride;
        vec4 f = textureLod(total, p / vec3(scene.dims), 0.0);
        float tau = f.a * scale;
        float passed = exp(-tau);
        radiance += f.rgb * (through * scale * mean_transmittance(tau, passed));
        through *= passed;
        t += stride + (steps_ahead(ray, p) - 1.0) * ray.dt;
        stride = ray.dt;
    }
    radiance /= scene.radiance_scale;
    float alpha = 1.0;
    if (BACKGROUND == BACKGROUND_TRANSPARENT) {
        alpha = 1.0 - through;
    } else if (BACKGROUND == BACKGROUND_COLOR) {
        radiance += through * scene.background;
    } else if (ENVIRONMENT != ENVIRONMENT_NONE) {
        radiance += through * environment_radiance(direction);
    }
    vec4 old = sample_index == 0u ? vec4(0.0) : imageLoad(picture, ivec2(pixel));
    imageStore(picture, ivec2(pixel), old + vec4(radiance, alpha) / float(samples));
}
