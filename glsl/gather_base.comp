#version 460
#extension GL_GOOGLE_include_directive : require
// Gather, step 2 of SAMPLING_RESIDUAL: the lower one of its two levels (DESIGN section 2, "Choosing directions"), the mean of
// M proxy energies, scattered by the points of the cell. gather_trace.comp adds the upper one, the mean of traced minus
// proxy.
// Grid: one invocation per cell of a chunk of the list.
#define LIST_BINDING 3
#define SAMPLES_BINDING 10
#define SAMPLES_ACCESS writeonly
#define SCATTERING_BINDING 5
#define SCENE_COPIED
#include "include/list.glsl"
#include "include/gather.glsl"
#include "include/scattering.glsl"
#include "include/scatter_sample.glsl"
#include "include/aim.glsl"

layout(local_size_x_id = 0) in;
// Samples are kept by direction; else only their mean is, and every point can have all directions: CELL_POINTS samples.
layout(constant_id = 1) const bool ANISOTROPIC = false;

// As gather_proxy.comp wrote them.
layout(set = 0, binding = 13, scalar) readonly buffer Weights { float weights[]; };

layout(push_constant, scalar) uniform GatherBasePush {
    uint chunk_begin;
    uint chunk_items;
    uint order;
    uint candidates;
    uint directions;
    // Samples of this dispatch.
    uint slot_begin;
    uint slot_end;
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
    vec2 shift = base_shift(key);
    uint flip = point_flip(key);
    Aim aim = make_aim(cell, for_eye);
    float mean = 0.0;
    bool is_directed = ANISOTROPIC;
    if (!is_directed) {
        for (uint c = 0u; c < candidates; c++) {
            mean += weights[(directions + c) * chunk_items + item];
        }
        mean /= float(candidates);
    }
    for (uint slot = slot_begin; slot < slot_end; slot++) {
        float energy = mean / float(CELL_POINTS);
        vec3 towards = vec3(0.0);
        if (is_directed) {
            towards = aimed_direction(aim, slot, candidates, shift);
            float weight = aimed_weight(aim, candidates, towards) / float(candidates);
            energy = weights[(directions + slot) * chunk_items + item] * weight;
        }
        uint point = point_of_sample(slot, flip);
        vec3 light = energy * scattering_at(position_of_point(cell, point));
        samples[(slot - slot_begin) * chunk_items + item] = ScatterSample(light, -towards, point);
    }
}
