#version 460
#extension GL_GOOGLE_include_directive : require
// Decompress: every voxel's run becomes its bucketID, in place (the paper's last proxy step).
// Grid: one invocation per voxel, 8 x 8 x 1 workgroups over the volume.
#include "include/scene.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 0, binding = 1, scalar) readonly buffer RunBucket { uint run_bucket[]; };
layout(set = 0, binding = 2, r32ui) uniform uimage3D bucket_id;

void main() {
    uvec3 voxel = gl_GlobalInvocationID;
    if (any(greaterThanEqual(voxel, scene.dims))) {
        return;
    }
    uint run = imageLoad(bucket_id, ivec3(voxel)).r;
    imageStore(bucket_id, ivec3(voxel), uvec4(run_bucket[run]));
}
