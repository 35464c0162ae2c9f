#version 460
#extension GL_GOOGLE_include_directive : require
// Gather, step 1: the energy that each candidate direction brings to the middle of a cell, estimated in the proxy with
// nearest reads and long steps (the paper's section on multiple scattering).
// Grid: x = cells of a chunk of the list, y = blocks of candidates.
#define LIST_BINDING 3
#define SCENE_COPIED
#include "include/list.glsl"
#include "include/march.glsl"
#include "include/cell.glsl"
#include "include/sphere.glsl"

layout(local_size_x_id = 0) in;
// As gather_trace.comp.
layout(constant_id = 3) const bool SKY = false;

layout(set = 0, binding = 5) uniform usampler3D bucket_id;
layout(set = 0, binding = 6, scalar) readonly buffer BucketLight { uint bucket_light[]; };
// [candidate][item of the chunk]
layout(set = 0, binding = 7, scalar) writeonly buffer Weights { float weights[]; };

layout(push_constant, scalar) uniform GatherProxyPush {
    uint chunk_begin;
    uint chunk_items;
    // Scattering order that is gathered: its stream of random numbers.
    uint order;
    uint candidates;
    // Candidates of one block.
    uint block;
    float step_voxels;
};

void main() {
    scene = scene_in_memory;
    uint item = gl_GlobalInvocationID.x;
    if (item >= items_in_chunk(chunk_begin, chunk_items)) {
        return;
    }
    uint index = list_items[chunk_begin + item];
    Cell cell = make_cell(cell_from_linear(index));
    uint key = stream_key(index, order, scene.seed_low, scene.seed_high);
    vec2 shift = vec2(random_float(key, 0u), random_float(key, 1u));
    uint begin = gl_WorkGroupID.y * block;
    uint end = min(begin + block, candidates);
    for (uint c = begin; c < end; c++) {
        Ray ray = make_ray(position_of(cell, vec3(0.5)), lattice_direction(c, candidates, shift), step_voxels);
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
        }
        if (SKY) {
            energy += through * scene.radiance_scale * dot(scene.environment, vec3(1.0 / 3.0));
        }
        weights[c * chunk_items + item] = energy;
    }
}
