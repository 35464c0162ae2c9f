// Kernels over a chunk of a list (compact.comp): which item is mine?
// The including kernel defines LIST_BINDING; the list is bound there, its header at the next number.
#ifndef LIST_GLSL
#define LIST_GLSL
#include "scene.glsl"

layout(set = 0, binding = LIST_BINDING, scalar) readonly buffer ListItems { uint list_items[]; };
layout(set = 0, binding = LIST_BINDING + 1, scalar) readonly buffer ListHeader { uint list_header[]; };

// Items of this chunk that exist.
uint items_in_chunk(uint begin, uint items) {
    uint count = list_header[LIST_COUNT];
    return min(items, count - min(begin, count));
}
#endif
