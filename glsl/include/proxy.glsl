// What the passes of the proxy share: the hash. Its loops stay loops: callers are unrolled, and unrolling these too cost
// seconds of pipeline compilation on lavapipe.
#ifndef PROXY_GLSL
#define PROXY_GLSL
#extension GL_EXT_control_flow_attributes : require
#include "constants.glsl"

// The bits of `color` that `mask` keeps, packed together: the hash. Distinct masked colours have distinct hashes.
uint hash_color(uint color, uint mask) {
    uint hash = 0u;
    uint place = 0u;
    [[dont_unroll]] for (uint bit = 0u; bit < 32u; bit++) {
        uint kept = mask >> bit & 1u;
        hash |= (color >> bit & kept) << min(place, 31u); // place < 32 wherever kept is 1
        place += kept;
    }
    return hash;
}

// The masked colour of a hash: the inverse of hash_color.
uint color_of_hash(uint hash, uint mask) {
    uint color = 0u;
    uint place = 0u;
    [[dont_unroll]] for (uint bit = 0u; bit < 32u; bit++) {
        uint kept = mask >> bit & 1u;
        color |= (hash >> min(place, 31u) & kept) << bit;
        place += kept;
    }
    return color;
}
#endif
