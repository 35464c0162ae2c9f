#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
// Extinction of every voxel in single precision, relative to the largest: what the path tracer flies through. Counts
// the voxels that have any.
// Grid: one invocation per voxel, 8 x 8 x 1 workgroups over the volume.
#include "include/scene.glsl"
#include "include/transfer.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 0, binding = 2) uniform sampler3D scalar;
layout(set = 0, binding = 3, r32f) writeonly uniform image3D extinction;
layout(set = 0, binding = 4, scalar) buffer Tally { uint tally[]; };

void main() {
    uvec3 voxel = gl_GlobalInvocationID;
    if (any(greaterThanEqual(voxel, scene.dims))) {
        return;
    }
    Material m = classify(texelFetch(scalar, ivec3(voxel), 0).r);
    uint occupied = subgroupAdd(m.extinction > 0.0 ? 1u : 0u);
    if (subgroupElect()) {
        atomicAdd(tally[TALLY_ACTIVE], occupied);
    }
    imageStore(extinction, ivec3(voxel), vec4(m.extinction / scene.max_extinction));
}
