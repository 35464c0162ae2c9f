// Steps that grow with the distance, each in the resolution that it needs: full, half, a quarter.
#ifndef MIPS_GLSL
#define MIPS_GLSL
#include "nearest.glsl"

// As mips.comp wrote them. In a word: source function (mean of the channels), extinction.
layout(set = 0, binding = 6) uniform usampler3D half_values;
layout(set = 0, binding = 7) uniform usampler3D quarter_values;
// Rgb = source function times extinction, a = extinction.
layout(set = 0, binding = 8) uniform sampler3D half_source;
layout(set = 0, binding = 9) uniform sampler3D quarter_source;

// A step of 2^level voxels at `p`.
void add_mip(inout Integral sum, uint level, vec3 p, float stride) {
    if (STRUCTURE == STRUCTURE_MIPS) {
        if (level == 0u) {
            add_sample(sum, p, stride);
            return;
        }
        count(0u, 1u, 0u);
        vec3 q = p / float(1u << level);
        vec4 f = level == 1u ? textureLod(half_source, q / vec3(textureSize(half_source, 0)), 0.0)
                             : textureLod(quarter_source, q / vec3(textureSize(quarter_source, 0)), 0.0);
        float tau = f.a * scene.max_extinction * stride;
        float passed = exp(-tau);
        sum.radiance += f.rgb * (sum.through * scene.max_extinction * stride * mean_transmittance(tau, passed));
        sum.through *= passed;
    } else {
        ivec3 voxel = clamp(ivec3(p), ivec3(0), ivec3(scene.dims) - 1) >> int(level);
        count(0u, 0u, 1u);
        uint value = level == 0u ? texelFetch(values, voxel, 0).r
                   : level == 1u ? texelFetch(half_values, voxel, 0).r
                                 : texelFetch(quarter_values, voxel, 0).r;
        add_light(sum, unpackHalf2x16(value), stride);
    }
}

// Steps of 2^level voxels up to `limit`; returns where the next one begins.
float trace_level(Ray ray, inout Integral sum, uint level, float t, float limit) {
    float end = min(limit, ray.end);
    ray.dt *= float(1u << level);
    while (t < end && sum.through > LEAST_ESTIMATED) {
        count(1u, 0u, 1u);
        float stride = min(ray.dt, ray.end - t);
        vec3 p = middle(ray, t, stride);
        add_mip(sum, level, p, stride);
        t += steps_ahead(ray, p) * ray.dt;
    }
    return t;
}

// `reach`: steps in full resolution; half of it takes as many, a quarter the rest.
void trace_mips(Ray ray, inout Integral sum, float reach) {
    float t = trace_level(ray, sum, 0u, ray.begin, reach * ray.dt);
    t = trace_level(ray, sum, 1u, t, 3.0 * reach * ray.dt);
    trace_level(ray, sum, 2u, t, ray.end);
}
#endif
