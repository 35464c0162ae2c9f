#version 460
#extension GL_GOOGLE_include_directive : require
// Gather, step 3: the chosen candidates are traced in the data from the points of the cell, and the light they carry is
// scattered once more.
// Grid: one invocation per cell of a chunk of the list.
#define LIST_BINDING 3
#define LIGHTS_BINDING 11
#define SAMPLES_BINDING 10
#define SAMPLES_ACCESS writeonly
#define SCENE_COPIED
#include "include/list.glsl"
#include "include/march.glsl"
#include "include/cell_scattering.glsl"
#include "include/scatter_sample.glsl"
#include "include/delta_lights.glsl"

layout(local_size_x_id = 0) in;
// The source has a B (project_deposit.comp).
layout(constant_id = 1) const bool ANISOTROPIC = false;
// What is gathered: SOURCE_*.
layout(constant_id = 2) const uint SOURCE = SOURCE_PROJECTED;
// A constant environment is behind everything, and gathered with the light of the orders before.
layout(constant_id = 3) const bool SKY = false;
layout(constant_id = 4) const uint SAMPLING = SAMPLING_PHASE;

layout(set = 0, binding = 5) uniform sampler3D scalar;
// Source of the order before: A and extinction; B by component for g ≠ 0 (project_deposit.comp).
layout(set = 0, binding = 6) uniform sampler3D source_a;
layout(set = 0, binding = 7) uniform sampler3D source_x;
layout(set = 0, binding = 8) uniform sampler3D source_y;
layout(set = 0, binding = 9) uniform sampler3D source_z;
// As gather_select.comp wrote it.
layout(set = 0, binding = 12, scalar) readonly buffer Chosen { uvec2 chosen[]; };

layout(push_constant, scalar) uniform GatherTracePush {
    uint chunk_begin;
    uint chunk_items;
    uint order;
    // Points of the lattice: M, or N where there are no candidates.
    uint lattice;
    // Slots of this dispatch, and of all.
    uint slot_begin;
    uint slot_end;
    uint directions;
    float step_voxels;
    // The delta light, with SOURCE_LIGHT.
    uint light;
};

// For SOURCE_LIGHT: where the light at `p` goes, and whether that differs from place to place.
vec3 light_travel(vec3 p) {
    return light_at(lights[light], world_from_index(p)).travel;
}

bool is_point_light() {
    bool point_lights = POINT_LIGHTS;
    return point_lights && lights[light].is_point != 0u;
}

// Direction of sample `number` of `count`. Light of one direction is scattered by the phase function about it, so that is
// how its directions are drawn, and the phase function itself cancels; all other light has even directions.
vec3 sampled_direction(uint number, uint count, vec2 shift) {
    if (SOURCE == SOURCE_LIGHT) {
        if (!is_point_light()) {
            return -sample_hg(scene.g, lights[light].vector, lattice_point(number, count, shift));
        }
    }
    return lattice_direction(number, count, shift);
}

// Radiance that arrives along the ray, against its direction `towards` (unit vector, world).
vec3 traced_radiance(Ray ray, vec3 towards) {
    float through = 1.0;
    vec3 radiance = vec3(0.0);
    Stepper at = first_step(ray);
    while (at.t < ray.end && through > LEAST_TRANSMITTANCE) {
        float stride = min(at.share * ray.dt, ray.end - at.t);
        vec3 p = ray.origin + ray.direction * (at.t + 0.5 * stride);
        vec3 uvw = p / vec3(scene.dims);
        vec4 f = textureLod(source_a, uvw, 0.0);
        vec3 source = f.rgb;
        if (ANISOTROPIC) {
            source -= textureLod(source_x, uvw, 0.0).rgb * towards.x + textureLod(source_y, uvw, 0.0).rgb * towards.y
                + textureLod(source_z, uvw, 0.0).rgb * towards.z;
        }
        float tau = f.a * scene.max_extinction * stride;
        float passed = exp(-tau);
        float scale = SOURCE == SOURCE_EMITTED ? scene.max_extinction * stride : tau;
        if (SOURCE == SOURCE_LIGHT) {
            if (is_point_light()) {
                scale *= 4.0 * PI * phase_hg(scene.g, dot(light_travel(p), -towards));
            }
        }
        radiance += source * (through * scale * mean_transmittance(tau, passed));
        through *= passed;
        step_on(at, ray, p);
    }
    if (SKY) {
        radiance += through * scene.radiance_scale * scene.environment;
    }
    return radiance;
}

void main() {
    scene = scene_in_memory;
    uint item = gl_GlobalInvocationID.x;
    if (item >= items_in_chunk(chunk_begin, chunk_items)) {
        return;
    }
    uint index = list_items[chunk_begin + item];
    Cell cell = make_cell(cell_from_linear(index));
    CornerScattering scattering = corner_scattering(scalar, cell);
    uint key = stream_key(index, order, scene.seed_low, scene.seed_high);
    vec2 shift = vec2(random_float(key, 0u), random_float(key, 1u));
    // Number 2 is gather_select.comp's.
    uint flip = uint(random_float(key, 3u) * float(CELL_POINTS));
    for (uint slot = slot_begin; slot < slot_end; slot++) {
        // Points by slot, not by candidate: whatever is chosen, every point gets its share.
        uint point = point_of_sample(slot, flip);
        vec3 place = point_place(cell, point);
        uint candidate = slot;
        float weight = 1.0 / float(directions);
        if (SAMPLING != SAMPLING_PHASE) {
            uvec2 choice = chosen[slot * chunk_items + item];
            candidate = choice.x;
            weight = uintBitsToFloat(choice.y);
        }
        vec3 towards = sampled_direction(candidate, lattice, shift);
        vec3 light = vec3(0.0);
        if (weight > 0.0) {
            Ray ray = make_ray(position_of(cell, place), towards, step_voxels);
            light = traced_radiance(ray, towards) * scattering_at(scattering, upper_weight(cell, place)) * weight;
        }
        samples[(slot - slot_begin) * chunk_items + item] = ScatterSample(light, -towards, point);
    }
}
