// Nearest reads: of bucketIDs, or of light and extinction in a word.
#ifndef NEAREST_GLSL
#define NEAREST_GLSL
#include "exact.glsl"

// By structure: bucketIDs, cubes.comp's words, or two half floats: source function (mean of the channels), extinction.
layout(set = 0, binding = 4) uniform usampler3D values;
// bucket_light.comp's words.
layout(set = 0, binding = 5, scalar) readonly buffer BucketLight { uint bucket_light[]; };

uint read_value(ivec3 voxel) {
    count(0u, 0u, 1u);
    return texelFetch(values, voxel, 0).r;
}

vec2 light_of_bucket(uint id) {
    count(0u, 0u, 1u);
    return unpackHalf2x16(bucket_light[id]);
}

// `light`: source function, extinction; `d`: world length.
void add_light(inout Integral sum, vec2 light, float d) {
    float passed = exp(-light.y * scene.max_extinction * d);
    sum.radiance += light.x * sum.through * (1.0 - passed);
    sum.through *= passed;
}

// Fixed steps that skip empty macrocells, as gather_proxy.comp.
void trace_nearest(Ray ray, inout Integral sum) {
    float t = ray.begin;
    while (t < ray.end && sum.through > LEAST_ESTIMATED) {
        count(1u, 0u, 1u);
        float stride = min(ray.dt, ray.end - t);
        vec3 p = middle(ray, t, stride);
        uint value = read_value(clamp(ivec3(p), ivec3(0), ivec3(scene.dims) - 1));
        add_light(sum, STRUCTURE == STRUCTURE_BUCKETS ? light_of_bucket(value) : unpackHalf2x16(value), stride);
        t += steps_ahead(ray, p) * ray.dt;
    }
}
#endif
