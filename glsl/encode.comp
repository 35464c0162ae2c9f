#version 460
#extension GL_GOOGLE_include_directive : require
// Encode: the 8-bit colour of every active voxel; empty voxels keep colour 0 (first half of DESIGN's "hash" step).
// Grid: one invocation per voxel of a chunk of the active list.
#define LIST_BINDING 1
#include "include/list.glsl"
#include "include/color_code.glsl"

layout(local_size_x_id = 0) in;

layout(set = 0, binding = 3) uniform sampler3D field;
layout(set = 0, binding = 4, scalar) readonly buffer SourceMax { uint source_max[]; };
layout(set = 0, binding = 5, r32ui) writeonly uniform uimage3D color;

layout(push_constant, scalar) uniform ChunkPush {
    uint chunk_begin;
    uint chunk_items;
};

void main() {
    uint item = gl_GlobalInvocationID.x;
    if (item >= items_in_chunk(chunk_begin, chunk_items)) {
        return;
    }
    ivec3 voxel = voxel_from_linear(list_items[chunk_begin + item]);
    uint code = encode_color(texelFetch(field, voxel, 0), uintBitsToFloat(source_max[0]));
    imageStore(color, voxel, uvec4(code));
}
