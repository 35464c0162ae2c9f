#version 460
#extension GL_GOOGLE_include_directive : require
// Deposit: adds the samples of a chunk of cells to the projection's right-hand side, b_i = ∫ v_i σ_s L dx over the hat
// functions v_i of the nodes (project_solve.comp). One corner of every cell per dispatch: then no two invocations meet
// in a node.
//
// Radiance arrives from many directions; stored are its first two moments (DESIGN section 2, "Direction dependence"):
//     source towards ω = σ (A + B·ω),  σ A = σ_s mean L,  σ B = 3 g σ_s mean(L ω_i),  ω_i and ω propagation directions,
// per channel. For g = 0 B is zero and not stored, and A is what the eye sees. For g ≠ 0 one eye's share uses the true
// phase function and has a sum of its own; for every eye there are A and B.
// Grid: one invocation per cell of a chunk of the list.
#define LIST_BINDING 1
#define SAMPLES_BINDING 3
#define SAMPLES_ACCESS readonly
#define SCENE_COPIED
#include "include/list.glsl"
#include "include/scatter_sample.glsl"

layout(local_size_x_id = 0) in;

// B is kept, beside A.
layout(constant_id = 1) const bool MOMENTS = false;
// The eye's share is kept; alone, where there is no B.
layout(constant_id = 2) const bool EYE = false;

layout(set = 0, binding = 4, SUM_FORMAT) uniform image3D sum_a;
layout(set = 0, binding = 5, SUM_FORMAT) uniform image3D sum_x;
layout(set = 0, binding = 6, SUM_FORMAT) uniform image3D sum_y;
layout(set = 0, binding = 7, SUM_FORMAT) uniform image3D sum_z;
layout(set = 0, binding = 8, SUM_FORMAT) uniform image3D sum_eye;

layout(push_constant, scalar) uniform ProjectDepositPush {
    uint chunk_begin;
    uint chunk_items;
    // Samples of every cell.
    uint slots;
    uint corner;
    // 1: the eye shall see this light through what is stored.
    uint is_seen;
};

void main() {
    scene = scene_in_memory;
    uint item = gl_GlobalInvocationID.x;
    if (item >= items_in_chunk(chunk_begin, chunk_items)) {
        return;
    }
    Cell cell = make_cell(cell_from_linear(list_items[chunk_begin + item]));
    ivec3 node = corner_node(cell, corner);
    if (!is_node(node)) {
        return;
    }
    vec3 a = vec3(0.0);
    vec3 x = vec3(0.0);
    vec3 y = vec3(0.0);
    vec3 z = vec3(0.0);
    vec3 eye = vec3(0.0);
    for (uint slot = 0u; slot < slots; slot++) {
        ScatterSample s = samples[slot * chunk_items + item];
        vec3 place = point_place(cell, s.point);
        vec3 light = corner_weight(upper_weight(cell, place), corner) * s.light;
        a += light;
        if (MOMENTS) {
            x += light * s.travel.x;
            y += light * s.travel.y;
            z += light * s.travel.z;
        }
        if (EYE) {
            vec3 to_eye = direction_to_eye(position_of(cell, place));
            eye += light * (4.0 * PI * phase_hg(scene.g, dot(s.travel, to_eye)));
        }
    }
    float volume = cell.size.x * cell.size.y * cell.size.z;
    bool needs_a = true;
    if (EYE) {
        needs_a = MOMENTS;
        if (is_seen != 0u) {
            imageStore(sum_eye, node, imageLoad(sum_eye, node) + vec4(eye * volume, 0.0));
        }
    }
    if (MOMENTS) {
        float b = 3.0 * scene.g * volume;
        imageStore(sum_x, node, imageLoad(sum_x, node) + vec4(x * b, 0.0));
        imageStore(sum_y, node, imageLoad(sum_y, node) + vec4(y * b, 0.0));
        imageStore(sum_z, node, imageLoad(sum_z, node) + vec4(z * b, 0.0));
    }
    if (needs_a) {
        imageStore(sum_a, node, imageLoad(sum_a, node) + vec4(a * volume, 0.0));
    }
}
