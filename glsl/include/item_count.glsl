// The number of items of a pass: from the host (push constant) or from the GPU (written by dispatch_args.comp).
// The including kernel defines ITEM_COUNT_BINDING.
#ifndef ITEM_COUNT_GLSL
#define ITEM_COUNT_GLSL
#include "constants.glsl"

layout(set = 0, binding = ITEM_COUNT_BINDING, scalar) readonly buffer Args { uint args[]; };

// `pushed` is the count itself, or COUNT_ON_DEVICE.
uint item_count(uint pushed) {
    return pushed == COUNT_ON_DEVICE ? args[ARGS_COUNT] : pushed;
}
#endif
