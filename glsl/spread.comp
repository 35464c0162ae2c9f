#version 460
#extension GL_GOOGLE_include_directive : require
// Spread: from the values that were solved for at the nodes of a coarse light grid (cell.glsl) to the voxels, which is what
// rays read: trilinear between nodes.
// Grid: one invocation per voxel, 8 x 8 x 1 workgroups.
#include "include/scene.glsl"
#include "include/stored.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

// rgb at the nodes, a = 1 where a node has a value and all is 0 where it has none.
layout(set = 0, binding = 1) uniform sampler3D nodes;
// a = extinction, where `total`, which has it too, is not added to.
layout(set = 0, binding = 2) uniform sampler3D field;
layout(set = 0, binding = 3, STORED_FORMAT) writeonly uniform image3D after;
layout(set = 0, binding = 4, STORED_FORMAT) uniform image3D total;
// At the voxels: light that enters every order.
layout(set = 0, binding = 5) uniform sampler3D fixed_light;

layout(push_constant, scalar) uniform SpreadPush {
    // 1: what is spread is added to `total`.
    uint adds;
    // 1: `after` gets `fixed_light` added.
    uint joins;
};

void main() {
    ivec3 voxel = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(voxel, ivec3(scene.dims)))) {
        return;
    }
    vec3 at = (vec3(voxel) + 0.5) / float(scene.light_edge);
    vec4 between = textureLod(nodes, at / vec3(scene.light_dims), 0.0);
    // Between those that have a value: else the medium's rims, which few points meet, would be dark.
    vec3 u = between.a > 0.0 ? between.rgb / between.a : vec3(0.0);
    float extinction;
    if (adds != 0u) {
        vec4 seen = from_stored(imageLoad(total, voxel));
        imageStore(total, voxel, to_stored(clamp(seen.rgb + u, -MAX_HALF, MAX_HALF), seen.a));
        extinction = seen.a;
    } else {
        extinction = texelFetch(field, voxel, 0).a;
    }
    if (joins != 0u) {
        u += texelFetch(fixed_light, voxel, 0).rgb;
    }
    imageStore(after, voxel, to_stored(clamp(u, -MAX_HALF, MAX_HALF), extinction));
}
