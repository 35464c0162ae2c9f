#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
// Largest source function A of the volume, over all channels: the range of the proxy's colour code.
// Grid: one invocation per voxel of a chunk of the active list.
#define LIST_BINDING 1
#include "include/list.glsl"

layout(local_size_x_id = 0) in;

layout(set = 0, binding = 3) uniform sampler3D field;
// Bits of a non-negative float, which order as integers.
layout(set = 0, binding = 4, scalar) buffer SourceMax { uint source_max[]; };

layout(push_constant, scalar) uniform ChunkPush {
    uint chunk_begin;
    uint chunk_items;
};

void main() {
    uint item = gl_GlobalInvocationID.x;
    float most = 0.0;
    if (item < items_in_chunk(chunk_begin, chunk_items)) {
        vec4 f = texelFetch(field, voxel_from_linear(list_items[chunk_begin + item]), 0);
        most = f.a > 0.0 ? max(0.0, max(f.r, max(f.g, f.b))) : 0.0;
    }
    most = subgroupMax(most);
    if (subgroupElect()) {
        atomicMax(source_max[0], floatBitsToUint(most));
    }
}
