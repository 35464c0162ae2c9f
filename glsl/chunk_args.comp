#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// Turns the length of a list, known on the GPU only, into arguments of one indirect dispatch per chunk of the list.
// Grid: one invocation per chunk.
#include "include/constants.glsl"

layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ListHeader { uint list_header[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer Args { uint args[]; };

layout(push_constant, scalar) uniform ChunkArgsPush {
    uint chunks;
    // List items of a chunk.
    uint chunk_items;
    // Workgroup size of the kernel that is dispatched, and its workgroups along y.
    uint workgroup;
    uint groups_y;
};

void main() {
    uint chunk = gl_GlobalInvocationID.x;
    if (chunk >= chunks) {
        return;
    }
    uint count = list_header[LIST_COUNT];
    uint begin = min(chunk * chunk_items, count);
    uint items = min(chunk_items, count - begin);
    args[3u * chunk] = (items + workgroup - 1u) / workgroup;
    args[3u * chunk + 1u] = groups_y;
    args[3u * chunk + 2u] = 1u;
}
