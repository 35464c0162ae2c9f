#version 460
#extension GL_GOOGLE_include_directive : require
// Pilot of the sampling `auto`: what a few cells tell of a gather's noise and cost (DESIGN section 2, "Choosing directions").
// In each of them PILOT_REPLICATES independent gathers follow the same directions in the data and in the proxy. What the
// replicates differ by is the variance of a mean over these evenly spread directions, which is less than that of independent
// ones. Steps are counted: they cost the same at every run, and time does not. A first look, before there is a proxy, counts
// those of a few rays in the data: whether a pilot is worth its time.
// Grid: x = cells drawn evenly from the list, y = replicates, z = blocks of directions: few cells alone would leave most of a
// large device idle.
#define LIST_BINDING 3
#define LIGHTS_BINDING 11
#define ESTIMATE_BINDING 12
#define POINTS_BINDING 14
#define SCATTERING_BINDING 5
#define SCENE_COPIED
#define COUNTED
#include "include/list.glsl"
#include "include/gather.glsl"
#include "include/cell.glsl"
#include "include/scattering.glsl"
#include "include/traced.glsl"
#include "include/estimate.glsl"
#include "include/points.glsl"

layout(local_size_x_id = 0) in;
// There is a proxy, and the directions are followed in it, too.
layout(constant_id = 4) const bool PROXY = true;

struct PilotSample {
    // A block's part of the light that the cell scatters, as a mean over its points and the directions: as `phase` has it,
    vec3 traced;
    // as the proxy has it, and
    vec3 base;
    // traced less the proxy's: the levels of SAMPLING_RESIDUAL.
    vec3 residual;
    // Steps of all rays in the data and in the proxy.
    uint traced_steps;
    uint proxy_steps;
};

// [block][replicate][cell]
layout(set = 0, binding = 10, scalar) writeonly buffer Pilots { PilotSample pilots[]; };

layout(push_constant, scalar) uniform PilotPush {
    // At most as many as the list has.
    uint cells;
    uint directions;
    // Directions of one block.
    uint block;
    float step_voxels;
    float proxy_step_voxels;
};

void main() {
    scene = scene_in_memory;
    uint number = gl_GlobalInvocationID.x;
    uint replicate = gl_WorkGroupID.y;
    if (number >= cells) {
        return;
    }
    // One of each of as many equal parts of the list.
    uint part = list_header[LIST_COUNT] / cells;
    uint draw = stream_key(number, PILOT_STREAM - 1u, scene.seed_low, scene.seed_high);
    uint index = list_items[number * part + draw % part];
    Cell cell = make_cell(cell_from_linear(index));
    uint key = stream_key(index, PILOT_STREAM + replicate, scene.seed_low, scene.seed_high);
    vec2 shift = lattice_shift(key);
    uint flip = point_flip(key);
    float energies = 0.0;
    PilotSample found = PilotSample(vec3(0.0), vec3(0.0), vec3(0.0), 0u, 0u);
    uint begin = gl_WorkGroupID.z * block;
    uint end = min(begin + block, directions);
    for (uint slot = begin; slot < end; slot++) {
        Dealt dealt = dealt_to(slot, directions, false, flip);
        uint point = dealt.point;
        vec3 position = position_of_point(cell, point);
        vec3 towards = lattice_direction(slot, directions, shift);
        vec3 radiance = traced_radiance(make_ray(position, towards, float(STEP_SAMPLES) * step_voxels), towards, 0u);
        float energy = 0.0;
        if (PROXY) {
            energy = estimated_energy(make_ray(position_of(cell, vec3(0.5)), towards, proxy_step_voxels));
        }
        vec3 scattered = scattering_at(position) * (dealt.weight / float(directions));
        found.traced += radiance * scattered;
        found.residual += (radiance - energy) * scattered;
        energies += energy / float(directions);
    }
    for (uint point = 0u; point < CELL_POINTS; point++) {
        vec3 scattered = scattering_at(position_of_point(cell, point));
        found.base += energies * scattered / float(CELL_POINTS);
    }
    found.traced_steps = traced_steps;
    found.proxy_steps = estimate_steps;
    pilots[(gl_WorkGroupID.z * PILOT_REPLICATES + replicate) * cells + number] = found;
}
