#version 460
#extension GL_GOOGLE_include_directive : require
// Bench of rays: radiance and transmittance along rays from points of cells in evenly spread directions, as the gather's,
// by one of the structures that `tyndall bench proxy` compares.
// Grid: x = cells, y = blocks of directions.
#define SCENE_COPIED
#include "include/constants.glsl"
// STRUCTURE_*.
layout(constant_id = 1) const uint STRUCTURE = STRUCTURE_NONE;
// Voxels along the edge of a macrocell.
layout(constant_id = 2) const uint EDGE = SKIP_SIZE;
#define SKIP_EDGE EDGE
#include "include/cell.glsl"
#include "include/sphere.glsl"
#include "include/bench/runs.glsl"
#include "include/bench/mips.glsl"

layout(local_size_x_id = 0) in;

layout(set = 0, binding = 10, scalar) readonly buffer Cells { uint cells[]; };
// [direction][cell]: radiance (mean of the channels), transmittance.
layout(set = 0, binding = 11, scalar) writeonly buffer Results { vec2 results[]; };
// With COUNTED, in the same order: steps, trilinear samples, nearest reads.
layout(set = 0, binding = 12, scalar) writeonly buffer Counts { uvec3 counted[]; };

layout(push_constant, scalar) uniform BenchRaysPush {
    uint cell_begin;
    uint cell_end;
    uint cell_count;
    uint directions;
    // Directions of one block.
    uint block;
    float step_voxels;
    // Of mips: steps in full resolution.
    float reach;
};

void trace(Ray ray, inout Integral sum) {
    if (STRUCTURE == STRUCTURE_CELLS) {
        trace_cells(ray, sum);
    } else if (STRUCTURE == STRUCTURE_RUNS) {
        trace_runs(ray, sum);
    } else if (STRUCTURE == STRUCTURE_CUBES) {
        trace_cubes(ray, sum);
    } else if (STRUCTURE == STRUCTURE_BUCKETS) {
        trace_nearest(ray, sum);
    } else if (STRUCTURE == STRUCTURE_VOXELS) {
        trace_nearest(ray, sum);
    } else if (STRUCTURE == STRUCTURE_MIPS) {
        trace_mips(ray, sum, reach);
    } else if (STRUCTURE == STRUCTURE_NEAREST_MIPS) {
        trace_mips(ray, sum, reach);
    } else {
        trace_exact(ray, sum);
    }
}

// The rays of one cell.
struct Origin {
    Cell cell;
    vec2 shift;
    uint flip;
};

Ray ray_of(Origin origin, uint d) {
    vec3 position = position_of_point(origin.cell, point_of_sample(d, origin.flip));
    return make_ray(position, lattice_direction(d, directions, origin.shift), step_voxels);
}

void store(uint i, Integral sum) {
    results[i] = vec2(dot(sum.radiance, vec3(1.0 / 3.0)), sum.through);
    if (COUNTED) {
        counted[i] = counts;
        counts = uvec3(0u);
    }
}

// Steps between two looks for lanes whose ray has ended.
const uint BATCH = 8u;

// One loop over the steps of all rays: a lane whose ray has ended starts its next one, and waits for no other lane.
void trace_flat(Origin origin, uint number, uint begin, uint end) {
    uint d = begin;
    Ray ray;
    Stepper at;
    Integral sum = Integral(vec3(0.0), 1.0);
    bool is_new = true;
    while (d < end) {
        if (is_new) {
            ray = ray_of(origin, d);
            at = first_step(ray);
            sum = Integral(vec3(0.0), 1.0);
        }
        for (uint k = 0u; k < BATCH && goes_on(ray, at, sum); k++) {
            step_exact(at, ray, sum);
        }
        is_new = !goes_on(ray, at, sum);
        if (is_new) {
            store(d * cell_count + number, sum);
            d++;
        }
    }
}

void main() {
    scene = scene_in_memory;
    uint number = cell_begin + gl_GlobalInvocationID.x;
    if (number >= cell_end) {
        return;
    }
    uint index = cells[number];
    uint key = stream_key(index, 0u, scene.seed_low, scene.seed_high);
    Origin origin;
    origin.cell = make_cell(cell_from_linear(index));
    origin.shift = vec2(random_float(key, 0u), random_float(key, 1u));
    origin.flip = uint(random_float(key, 3u) * float(CELL_POINTS));
    uint begin = gl_WorkGroupID.y * block;
    uint end = min(begin + block, directions);
    if (STRUCTURE == STRUCTURE_FLAT) {
        trace_flat(origin, number, begin, end);
    } else {
        for (uint d = begin; d < end; d++) {
            Integral sum = Integral(vec3(0.0), 1.0);
            trace(ray_of(origin, d), sum);
            store(d * cell_count + number, sum);
        }
    }
}
