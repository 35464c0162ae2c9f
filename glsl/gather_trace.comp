#version 460
#extension GL_GOOGLE_include_directive : require
// Gather, step 3: the chosen directions are traced in the data, and the light they carry is scattered once more.
// Grid: one invocation per voxel of a chunk of the active list.
#define ACTIVE_BINDING 3
#define NEXT_BINDING 10
#include "include/transfer.glsl"
#include "include/march.glsl"
#include "include/rng.glsl"
#include "include/active.glsl"
#include "include/contribute.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 4) const uint SAMPLING = SAMPLING_PHASE;

layout(set = 0, binding = 5) uniform sampler3D scalar;
// Source of the order before: A and extinction; B by component for g ≠ 0 (contribute.glsl).
layout(set = 0, binding = 6) uniform sampler3D source_a;
layout(set = 0, binding = 7) uniform sampler3D source_x;
layout(set = 0, binding = 8) uniform sampler3D source_y;
layout(set = 0, binding = 9) uniform sampler3D source_z;
// As gather_select.comp wrote it.
layout(set = 0, binding = 15, scalar) readonly buffer Chosen { uvec2 chosen[]; };

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
    // The first dispatch to write this order's source.
    uint first;
    float step_voxels;
};

// Radiance that arrives along the ray, against its direction `towards` (unit vector, world).
vec3 traced_radiance(Ray ray, vec3 towards) {
    float through = 1.0;
    vec3 radiance = vec3(0.0);
    float t = ray.begin;
    while (t < ray.end && through > LEAST_TRANSMITTANCE) {
        float stride = min(ray.dt, ray.end - t);
        vec3 p = ray.origin + ray.direction * (t + 0.5 * stride);
        vec3 uvw = p / vec3(scene.dims);
        vec4 f = textureLod(source_a, uvw, 0.0);
        vec3 source = f.rgb;
        if (ANISOTROPIC) {
            source -= textureLod(source_x, uvw, 0.0).rgb * towards.x + textureLod(source_y, uvw, 0.0).rgb * towards.y
                + textureLod(source_z, uvw, 0.0).rgb * towards.z;
            source = max(source, 0.0);
        }
        float scale = scene.max_extinction * stride;
        float tau = f.a * scale;
        float passed = exp(-tau);
        radiance += source * (through * scale * mean_transmittance(tau, passed));
        through *= passed;
        t += steps_ahead(ray, p) * ray.dt;
    }
    return radiance;
}

void main() {
    uint item = gl_GlobalInvocationID.x;
    if (item >= items_in_chunk(chunk_begin, chunk_items)) {
        return;
    }
    uint index = active_voxels[chunk_begin + item];
    ivec3 voxel = ivec3(voxel_from_linear(index));
    vec3 position = vec3(voxel) + 0.5;
    vec3 to_eye = direction_to_eye(position);
    uint key = stream_key(index, order, scene.seed_low, scene.seed_high);
    vec2 shift = vec2(random_float(key, 0u), random_float(key, 1u));
    Arrived sum = nothing();
    for (uint slot = slot_begin; slot < slot_end; slot++) {
        uint candidate = slot;
        float weight = 1.0 / float(directions);
        if (SAMPLING != SAMPLING_PHASE) {
            uvec2 choice = chosen[slot * chunk_items + item];
            candidate = choice.x;
            weight = uintBitsToFloat(choice.y);
        }
        if (weight > 0.0) {
            vec3 towards = lattice_direction(candidate, lattice, shift);
            vec3 radiance = traced_radiance(make_ray(position, towards, step_voxels), towards);
            arrive(sum, radiance * weight, -towards, to_eye);
        }
    }
    Material m = classify(texelFetch(scalar, voxel, 0).r);
    vec3 albedo = albedo_of(m);
    float extinction = m.extinction / scene.max_extinction;
    add_to(voxel, albedo * extinction, sum, extinction, first != 0u);
}
