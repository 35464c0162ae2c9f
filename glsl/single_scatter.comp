#version 460
#extension GL_GOOGLE_include_directive : require
// Single scattering: light of order 1 at the points of every cell from delta lights and the environment, by marching the
// transmittance to each (DESIGN section 2).
// Grid: one invocation per cell of a chunk of the list.
#define LIST_BINDING 3
#define LIGHTS_BINDING 5
#define SAMPLES_BINDING 7
#define SAMPLES_ACCESS writeonly
#define SCATTERING_BINDING 12
#define ENVIRONMENT_BINDING 13
#define ENVIRONMENT_SAMPLING
#define SCENE_COPIED
#include "include/list.glsl"
#include "include/march.glsl"
#include "include/scattering.glsl"
#include "include/scatter_sample.glsl"
#include "include/delta_lights.glsl"
#include "include/environment.glsl"

layout(local_size_x_id = 0) in;

layout(set = 0, binding = 6) uniform sampler3D field;

layout(push_constant, scalar) uniform SingleScatterPush {
    uint chunk_begin;
    uint chunk_items;
    // Samples of the delta lights in this dispatch: LIGHT_POINTS of each.
    uint light_begin;
    uint light_end;
    // Environment directions in this dispatch, and of all.
    uint environment_begin;
    uint environment_end;
    uint environment_directions;
    float step_voxels;
};

void main() {
    scene = scene_in_memory;
    uint item = gl_GlobalInvocationID.x;
    if (item >= items_in_chunk(chunk_begin, chunk_items)) {
        return;
    }
    uint index = list_items[chunk_begin + item];
    Cell cell = make_cell(cell_from_linear(index));
    uint key = stream_key(index, 1u, scene.seed_low, scene.seed_high);
    uint flip = uint(random_float(key, 2u) * float(CELL_POINTS));
    uint slot = item;
    for (uint i = light_begin; i < light_end; i++) {
        uint l = i / LIGHT_POINTS;
        uint point = point_of_sample(i % LIGHT_POINTS, flip);
        vec3 position = position_of_point(cell, point);
        LightArrival light = light_at(lights[l], world_from_index(position));
        float t = transmittance(field, make_ray(position, -light.travel, float(STEP_SAMPLES) * step_voxels), light.reach);
        float weight = t * scene.radiance_scale / (4.0 * PI * float(LIGHT_POINTS));
        vec3 scattered = scattering_at(position) * light.irradiance * weight;
        samples[slot] = ScatterSample(scattered, light.travel, point);
        slot += chunk_items;
    }
    if (ENVIRONMENT != ENVIRONMENT_NONE) {
        vec2 shift = vec2(random_float(key, 0u), random_float(key, 1u));
        for (uint i = environment_begin; i < environment_end; i++) {
            uint point = point_of_sample(i, flip);
            vec3 position = position_of_point(cell, point);
            EnvironmentSample s = sample_environment(i, environment_directions, shift);
            Ray ray = make_ray(position, s.direction, float(STEP_SAMPLES) * step_voxels);
            float weight = transmittance(field, ray, 3.0e38) * s.weight * scene.radiance_scale / (4.0 * PI);
            vec3 scattered = scattering_at(position) * s.radiance * weight;
            samples[slot] = ScatterSample(scattered, -s.direction, point);
            slot += chunk_items;
        }
    }
}
