// The energy that a direction has in the proxy: nearest reads and long steps (the paper's section on multiple scattering).
// The including kernel defines ESTIMATE_BINDING, SKY, and with COUNTED counts steps.
#ifndef ESTIMATE_GLSL
#define ESTIMATE_GLSL
#include "march.glsl"

layout(set = 0, binding = ESTIMATE_BINDING) uniform usampler3D bucket_id;
layout(set = 0, binding = ESTIMATE_BINDING + 1, scalar) readonly buffer BucketLight { uint bucket_light[]; };

#ifdef COUNTED
uint estimate_steps = 0u;
#endif

// Mean of the channels of the radiance that arrives along the ray.
float estimated_energy(Ray ray) {
    float through = 1.0;
    float energy = 0.0;
    float t = ray.begin;
    while (t < ray.end && through > 0.01) {
        float stride = min(ray.dt, ray.end - t);
        vec3 p = ray.origin + ray.direction * (t + 0.5 * stride);
        ivec3 voxel = clamp(ivec3(p), ivec3(0), ivec3(scene.dims) - 1);
        vec2 light = unpackHalf2x16(bucket_light[texelFetch(bucket_id, voxel, 0).r]);
        float passed = exp(-light.y * scene.max_extinction * stride);
        energy += through * (1.0 - passed) * light.x;
        through *= passed;
        t += steps_ahead(ray, p) * ray.dt;
#ifdef COUNTED
        estimate_steps++;
#endif
    }
    if (SKY) {
        energy += through * scene.radiance_scale * dot(scene.environment, vec3(1.0 / 3.0));
    }
    return energy;
}
#endif
