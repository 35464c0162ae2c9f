#version 460
#extension GL_GOOGLE_include_directive : require
// Gather, step 3: the chosen candidates are traced in the data from the points of the cell, and the light they carry is
// scattered once more. With SAMPLING_RESIDUAL less what the proxy had for them.
// Grid: one invocation per cell of a chunk of the list.
#define LIST_BINDING 3
#define LIGHTS_BINDING 11
#define SAMPLES_BINDING 10
#define POINTS_BINDING 14
#define SAMPLES_ACCESS writeonly
#define SCATTERING_BINDING 5
#define SCENE_COPIED
#include "include/list.glsl"
#include "include/gather.glsl"
#include "include/scattering.glsl"
#include "include/scatter_sample.glsl"
#include "include/traced.glsl"
#include "include/aim.glsl"
#include "include/points.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 4) const uint SAMPLING = SAMPLING_PHASE;

// As gather_select.comp wrote it.
layout(set = 0, binding = 12, scalar) readonly buffer Chosen { uvec2 chosen[]; };
// As gather_proxy.comp wrote them: those of the traced directions come first.
layout(set = 0, binding = 13, scalar) readonly buffer Weights { float weights[]; };

layout(push_constant, scalar) uniform GatherTracePush {
    uint chunk_begin;
    uint chunk_items;
    uint order;
    // Points of the lattice: M where the traced directions are chosen from candidates, else N.
    uint lattice;
    // Slots of this dispatch, and of all.
    uint slot_begin;
    uint slot_end;
    uint directions;
    float step_voxels;
    // The delta light, with SOURCE_LIGHT.
    uint light;
    // 1: nobody but the eye will see it.
    uint for_eye;
};

// Direction of sample `number` of `count`. Light of one direction is scattered by the phase function about it, so that is
// how its directions are drawn, and the phase function itself cancels.
vec3 sampled_direction(Aim aim, uint number, uint count, vec2 shift) {
    if (SOURCE == SOURCE_LIGHT) {
        if (!is_point_light(light)) {
            return -sample_hg(scene.g, lights[light].vector, lattice_point(number, count, shift));
        }
    }
    return aimed_direction(aim, number, count, shift);
}

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
    uint flip = point_flip(key);
    Aim aim = make_aim(cell, for_eye);
    bool is_top = SAMPLING == SAMPLING_TOP;
    bool is_resampled = SAMPLING == SAMPLING_RESAMPLE;
    bool is_choice = is_top || is_resampled;
    for (uint slot = slot_begin; slot < slot_end; slot++) {
        // Points by slot, not by candidate: whatever is chosen, every point gets its share.
        Dealt dealt = dealt_to(slot, directions, aim.at_eye, flip);
        uint point = dealt.point;
        uint candidate = slot;
        float weight = dealt.weight / float(directions);
        if (is_choice) {
            uvec2 choice = chosen[slot * chunk_items + item];
            candidate = choice.x;
            weight = uintBitsToFloat(choice.y);
        }
        vec3 towards = sampled_direction(aim, candidate, lattice, shift);
        vec3 radiance = vec3(0.0);
        if (weight > 0.0) {
            vec3 position = position_of_point(cell, point);
            Ray ray = make_ray(position, towards, float(STEP_SAMPLES) * step_voxels);
            radiance = traced_radiance(ray, towards, light);
            if (SAMPLING == SAMPLING_RESIDUAL) {
                radiance -= weights[slot * chunk_items + item];
            }
            radiance *= scattering_at(position) * (weight * aimed_weight(aim, lattice, towards));
        }
        samples[(slot - slot_begin) * chunk_items + item] = ScatterSample(radiance, -towards, point);
    }
}
