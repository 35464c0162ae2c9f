#version 460
#extension GL_GOOGLE_include_directive : require
// Gather, step 1: the energy that each candidate direction brings to the middle of a cell, estimated in the proxy.
// Grid: x = cells of a chunk of the list, y = blocks of directions.
#define LIST_BINDING 3
#define ESTIMATE_BINDING 5
#define SCENE_COPIED
#include "include/list.glsl"
#include "include/aim.glsl"
#include "include/gather.glsl"

layout(local_size_x_id = 0) in;
// As gather_trace.comp.
layout(constant_id = 3) const bool SKY = false;
layout(constant_id = 4) const uint SAMPLING = SAMPLING_RESAMPLE;

#include "include/estimate.glsl"

// [candidate][item of the chunk]; with SAMPLING_RESIDUAL the N directions that are traced come first, the M others follow.
layout(set = 0, binding = 7, scalar) writeonly buffer Weights { float weights[]; };

layout(push_constant, scalar) uniform GatherProxyPush {
    uint chunk_begin;
    uint chunk_items;
    // Scattering order that is gathered: its stream of random numbers.
    uint order;
    uint candidates;
    uint directions;
    // Directions of one block.
    uint block;
    float step_voxels;
    // As gather_trace.comp.
    uint for_eye;
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
    vec2 shift = lattice_shift(key);
    vec2 other_shift = base_shift(key);
    Aim aim = make_aim(cell, for_eye);
    uint begin = gl_WorkGroupID.y * block;
    uint end = min(begin + block, SAMPLING == SAMPLING_RESIDUAL ? directions + candidates : candidates);
    for (uint c = begin; c < end; c++) {
        vec3 towards;
        if (SAMPLING == SAMPLING_RESIDUAL) {
            bool is_traced = c < directions;
            uint number = is_traced ? c : c - directions;
            towards =
                aimed_direction(aim, number, is_traced ? directions : candidates, is_traced ? shift : other_shift);
        } else {
            towards = aimed_direction(aim, c, candidates, shift);
        }
        Ray ray = make_ray(position_of(cell, vec3(0.5)), towards, step_voxels);
        float energy = estimated_energy(ray);
        if (SAMPLING != SAMPLING_RESIDUAL) {
            // What the choice goes by: what the eye would get of it.
            energy *= eye_density(aim, towards) * aimed_weight(aim, candidates, towards);
        }
        weights[c * chunk_items + item] = energy;
    }
}
