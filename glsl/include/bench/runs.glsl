// Stretches of equal light, crossed in one step of the closed form S (1 − e^−σd): the paper's runs, and aligned cubes.
#ifndef RUNS_GLSL
#define RUNS_GLSL
#include "nearest.glsl"

// The paper's rule: bucketIDs are compared voxel by voxel, and a run of equal ones is one step.
void trace_runs(Ray ray, inout Integral sum) {
    ivec3 last = ivec3(scene.dims) - 1;
    bvec3 is_up = greaterThan(ray.inverse, vec3(0.0));
    ivec3 turn = ivec3(is_up) * 2 - 1;
    ivec3 voxel = clamp(ivec3(floor(ray.origin + ray.direction * ray.begin)), ivec3(0), last);
    // Where the ray leaves the voxel along every axis.
    vec3 next = (vec3(voxel) + vec3(is_up) - ray.origin) * ray.inverse;
    float t = ray.begin;
    float begin = t;
    uint id = read_value(voxel);
    while (t < ray.end && sum.through > LEAST_ESTIMATED) {
        count(1u, 0u, 0u);
        t = min(min(next.x, next.y), min(next.z, ray.end));
        bvec3 is_crossed = lessThanEqual(next, vec3(t));
        voxel += ivec3(is_crossed) * turn;
        next += vec3(is_crossed) * abs(ray.inverse);
        uint other = read_value(clamp(voxel, ivec3(0), last));
        if (other != id || t >= ray.end) {
            add_light(sum, light_of_bucket(id), t - begin);
            begin = t;
            id = other;
        }
    }
}

// Every voxel knows the largest aligned cube of its own bucketID that it lies in: a cube is one step.
void trace_cubes(Ray ray, inout Integral sum) {
    bvec3 is_up = greaterThan(ray.inverse, vec3(0.0));
    // Into the next cube, whatever rounding does.
    float nudge = 1e-3 * ray.dt;
    float t = ray.begin;
    while (t < ray.end && sum.through > LEAST_ESTIMATED) {
        count(1u, 0u, 0u);
        ivec3 voxel = clamp(ivec3(ray.origin + ray.direction * (t + nudge)), ivec3(0), ivec3(scene.dims) - 1);
        uint word = read_value(voxel);
        uint level = word >> CUBES_VALUE_BITS;
        uvec3 low = uvec3(voxel) >> level << level;
        vec3 face = mix(vec3(low), vec3(low + (1u << level)), is_up);
        vec3 leave = (face - ray.origin) * ray.inverse;
        float next = clamp(min(leave.x, min(leave.y, leave.z)), t + nudge, ray.end);
        add_light(sum, light_of_bucket(word & (1u << CUBES_VALUE_BITS) - 1u), next - t);
        t = next;
    }
}
#endif
