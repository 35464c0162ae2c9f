#version 460
#extension GL_GOOGLE_include_directive : require
// Single scattering: the order-1 source of every active voxel from delta lights and the environment, by marching the
// transmittance to each (DESIGN section 2). The delta lights' part is for the next order only.
// Grid: one invocation per voxel of a chunk of the active list.
#define ACTIVE_BINDING 3
#define LIGHTS_BINDING 5
#define NEXT_BINDING 7
#define ENVIRONMENT_BINDING 13
#define ENVIRONMENT_SAMPLING
#include "include/scene.glsl"
#include "include/transfer.glsl"
#include "include/march.glsl"
#include "include/rng.glsl"
#include "include/active.glsl"
#include "include/contribute.glsl"
#include "include/delta_lights.glsl"
#include "include/environment.glsl"

layout(local_size_x_id = 0) in;

layout(set = 0, binding = 6) uniform sampler3D field;
layout(set = 0, binding = 12) uniform sampler3D scalar;

layout(push_constant, scalar) uniform SingleScatterPush {
    uint chunk_begin;
    uint chunk_items;
    // Lights of this dispatch.
    uint light_begin;
    uint light_end;
    // Environment directions of this dispatch, and of all.
    uint environment_begin;
    uint environment_end;
    uint environment_directions;
    // The first dispatch to write this order's source.
    uint first;
    float step_voxels;
};

void main() {
    uint item = gl_GlobalInvocationID.x;
    if (item >= items_in_chunk(chunk_begin, chunk_items)) {
        return;
    }
    uint index = active_voxels[chunk_begin + item];
    ivec3 voxel = ivec3(voxel_from_linear(index));
    vec3 position = vec3(voxel) + 0.5;
    vec3 world = world_from_index(position);
    vec3 to_eye = direction_to_eye(position);
    Material m = classify(texelFetch(scalar, voxel, 0).r);

    Arrived sum = nothing();
    for (uint l = light_begin; l < light_end; l++) {
        LightArrival light = light_at(lights[l], world);
        float t = transmittance(field, make_ray(position, -light.travel, step_voxels), light.reach);
        // The camera adds what the eye sees of delta lights, without the cache's error (camera.comp).
        arrive_unseen(sum, light.irradiance * (t / (4.0 * PI)), light.travel);
    }
    if (ENVIRONMENT != ENVIRONMENT_NONE) {
        uint key = stream_key(index, 1u, scene.seed_low, scene.seed_high);
        vec2 shift = vec2(random_float(key, 0u), random_float(key, 1u));
        for (uint i = environment_begin; i < environment_end; i++) {
            EnvironmentSample s = sample_environment(i, environment_directions, shift);
            float t = transmittance(field, make_ray(position, s.direction, step_voxels), 3.0e38);
            arrive(sum, s.radiance * (t * s.weight / (4.0 * PI)), -s.direction, to_eye);
        }
    }
    vec3 scattering = albedo_of(m) * (m.extinction / scene.max_extinction) * scene.radiance_scale;
    add_to(voxel, scattering, sum, m.extinction / scene.max_extinction, first != 0u);
}
