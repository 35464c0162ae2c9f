// Kernels over a chunk of the list of active voxels: which voxel is mine?
// The including kernel defines ACTIVE_BINDING; the list is bound there, its header at the next number.
#ifndef ACTIVE_GLSL
#define ACTIVE_GLSL
#include "scene.glsl"

layout(set = 0, binding = ACTIVE_BINDING, scalar) readonly buffer ActiveVoxels { uint active_voxels[]; };
layout(set = 0, binding = ACTIVE_BINDING + 1, scalar) readonly buffer ListHeader { uint list_header[]; };

// Items of this chunk that exist.
uint items_in_chunk(uint begin, uint items) {
    uint count = list_header[LIST_COUNT];
    return min(items, count - min(begin, count));
}
#endif
