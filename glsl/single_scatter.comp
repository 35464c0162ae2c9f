#version 460
#extension GL_GOOGLE_include_directive : require
// Single scattering: the order-1 source of every active voxel from delta lights and the environment, by marching the
// transmittance to each (DESIGN section 2).
// Grid: one invocation per voxel of a chunk of the active list.
#define ACTIVE_BINDING 3
#define NEXT_BINDING 7
#define ENVIRONMENT_BINDING 13
#define ENVIRONMENT_SAMPLING
#include "include/scene.glsl"
#include "include/transfer.glsl"
#include "include/march.glsl"
#include "include/rng.glsl"
#include "include/active.glsl"
#include "include/contribute.glsl"
#include "include/environment.glsl"

layout(local_size_x_id = 0) in;

struct LightData {
    // Directional (is_point = 0): direction of travel; point: position. World.
    vec3 vector;
    uint is_point;
    // Irradiance or radiant intensity.
    vec3 power;
};

layout(set = 0, binding = 5, scalar) readonly buffer Lights { LightData lights[]; };
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

// Transmittance along `ray` up to `limit`.
float transmittance(Ray ray, float limit) {
    float end = min(ray.end, limit);
    float tau = 0.0;
    float t = ray.begin;
    // e^−7 is below LEAST_TRANSMITTANCE. The host keeps rays * steps within MAX_ITERATIONS.
    while (t < end && tau < 7.0) {
        float stride = min(ray.dt, end - t);
        vec3 p = ray.origin + ray.direction * (t + 0.5 * stride);
        tau += textureLod(field, p / vec3(scene.dims), 0.0).a * scene.max_extinction * stride;
        t += steps_ahead(ray, p) * ray.dt;
    }
    return tau < 7.0 ? exp(-tau) : 0.0;
}

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
        LightData light = lights[l];
        vec3 travel = light.vector;
        vec3 irradiance = light.power;
        float reach = 3.0e38;
        if (light.is_point != 0u) {
            vec3 d = world - light.vector;
            // A light inside a voxel lights it as if from half a voxel away: the voxel's own mean, not a singularity.
            float least = 0.5 * scene.mean_spacing;
            reach = length(d);
            travel = reach > 0.0 ? d / reach : vec3(0.0, 0.0, 1.0);
            irradiance /= max(reach, least) * max(reach, least);
        }
        float t = transmittance(make_ray(position, -travel, step_voxels), reach);
        arrive(sum, irradiance * (t / (4.0 * PI)), travel, to_eye);
    }
    if (ENVIRONMENT != ENVIRONMENT_NONE) {
        uint key = stream_key(index, 1u, scene.seed_low, scene.seed_high);
        vec2 shift = vec2(random_float(key, 0u), random_float(key, 1u));
        for (uint i = environment_begin; i < environment_end; i++) {
            EnvironmentSample s = sample_environment(i, environment_directions, shift);
            float t = transmittance(make_ray(position, s.direction, step_voxels), 3.0e38);
            arrive(sum, s.radiance * (t * s.weight / (4.0 * PI)), -s.direction, to_eye);
        }
    }
    vec3 scattering = albedo_of(m) * (m.extinction / scene.max_extinction) * scene.radiance_scale;
    add_to(voxel, scattering, sum, m.extinction / scene.max_extinction, first != 0u);
}
