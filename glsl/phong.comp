#version 460
#extension GL_GOOGLE_include_directive : require
// Local shading (Levoy 1988 with Blinn's half vector): the transfer function's colour, lit by gradient and lights, as
// the source that the camera integrates. No shadows, no scattering.
// Grid: one invocation per voxel of a chunk of the active list.
#define LIST_BINDING 2
#define LIGHTS_BINDING 4
#include "include/transfer.glsl"
#include "include/list.glsl"
#include "include/delta_lights.glsl"
#include "include/sphere.glsl"
#include "include/stored.glsl"

layout(local_size_x_id = 0) in;

layout(set = 0, binding = 5) uniform sampler3D scalar;
layout(set = 0, binding = 6, STORED_FORMAT) writeonly uniform image3D total;

layout(push_constant, scalar) uniform PhongPush {
    uint chunk_begin;
    uint chunk_items;
    uint lights_count;
    // Mean radiance of the environment: the ambient light.
    vec3 ambient;
};

const float SPECULAR = 0.25;
const float SHININESS = 40.0;

// Where there is no scalar, `here` stands in: it makes no gradient.
float scalar_at(ivec3 voxel, float here) {
    float value = texelFetch(scalar, clamp(voxel, ivec3(0), ivec3(scene.dims) - 1), 0).r;
    return value == NO_VALUE ? here : value;
}

// Part of the difference across the voxel: of any two scalars it may be divided by. Only the gradient's direction counts.
float slope_along(ivec3 voxel, ivec3 axis, float here) {
    return DIFFERENCE_SCALE * scalar_at(voxel + axis, here) - DIFFERENCE_SCALE * scalar_at(voxel - axis, here);
}

void main() {
    uint item = gl_GlobalInvocationID.x;
    if (item >= items_in_chunk(chunk_begin, chunk_items)) {
        return;
    }
    ivec3 voxel = voxel_from_linear(list_items[chunk_begin + item]);
    float here = texelFetch(scalar, voxel, 0).r;
    Material m = classify(here);
    vec3 world = world_from_index(vec3(voxel) + 0.5);
    vec3 slope = vec3(
        slope_along(voxel, ivec3(1, 0, 0), here),
        slope_along(voxel, ivec3(0, 1, 0), here),
        slope_along(voxel, ivec3(0, 0, 1), here));
    // Only the direction counts; squares of large scalars would overflow.
    slope /= max(max(abs(slope.x), abs(slope.y)), max(abs(slope.z), 1e-37));
    // Gradients are covectors: they turn with the transposed inverse, whose rows are the columns of world-to-index.
    vec3 gradient = vec3(dot(scene.index_of_x, slope), dot(scene.index_of_y, slope), dot(scene.index_of_z, slope));
    vec3 to_eye = direction_to_eye(vec3(voxel) + 0.5);
    float steepness = length(gradient);
    vec3 normal = steepness > 0.0 ? gradient / steepness : to_eye;
    // Surfaces are lit on the side that is seen.
    normal *= dot(normal, to_eye) < 0.0 ? -1.0 : 1.0;
    vec3 lit = m.color * ambient;
    for (uint l = 0u; l < lights_count; l++) {
        LightArrival light = light_at(lights[l], world);
        vec3 to_light = -light.travel;
        float facing = max(0.0, dot(normal, to_light));
        float shine = facing > 0.0 ? pow(max(0.0, dot(normal, normalize(to_light + to_eye))), SHININESS) : 0.0;
        lit += light.irradiance / PI * (m.color * facing + SPECULAR * shine);
    }
    float extinction = m.extinction / scene.max_extinction;
    imageStore(total, voxel, to_stored(min(lit * extinction * scene.radiance_scale, MAX_HALF), extinction));
}
