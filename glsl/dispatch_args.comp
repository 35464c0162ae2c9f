// Turns a count that a kernel wrote into the arguments of indirect dispatches, one workgroup per tile.
//
// Grid: one invocation. Buffers: counts[offset] = the count; args = a VkDispatchIndirectCommand for tiles of tile_items items,
// and the count at word ARGS_COUNT, clamped to `capacity`. A count above the capacity is an error for whoever reads
// `diagnostics`.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_KHR_memory_scope_semantics : require
#include "include/constants.glsl"

layout(local_size_x = 1) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer Args { uint args[]; };
layout(set = 0, binding = 2, scalar) buffer Diagnostics { uint diagnostics[]; };

layout(push_constant, scalar) uniform DispatchArgsPush {
    uint offset;
    uint capacity;
    uint tile_items;
    uint least_tiles; // workgroups there are even for no item: 0 or 1
};

void main() {
    uint count = counts[offset];
    if (count > capacity) {
        atomicOr(diagnostics[DIAGNOSTICS_ERRORS], ERROR_COUNT, gl_ScopeDevice, 0, 0);
        count = capacity;
    }
    uint tiles = max(count / tile_items + (count % tile_items == 0u ? 0u : 1u), least_tiles);
    uint width = min(tiles, MAX_GRID);
    args[0] = width;
    args[1] = width == 0u ? 1u : (tiles + width - 1u) / width;
    args[2] = 1u;
    args[ARGS_COUNT] = count;
}
