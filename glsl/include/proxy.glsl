// What the passes of the proxy share: the hash by the quantiser's levels (quantiser.comp).
// The including kernel defines QUANTISER_BINDING.
#ifndef PROXY_GLSL
#define PROXY_GLSL
#extension GL_EXT_scalar_block_layout : require
#include "constants.glsl"

layout(set = 0, binding = QUANTISER_BINDING, scalar) readonly buffer Quantiser { uint quantiser[]; };

uint code_of(uint color, uint channel) {
    return color >> 8u * channel & 0xFFu;
}

uint level_of(uint color, uint channel) {
    return quantiser[QUANTISER_LEVELS + channel * CODES + code_of(color, channel)];
}

// The levels of a colour as the digits of one number, R the lowest. `levels`: their numbers. Distinct levels have distinct
// hashes, which take no more bits than there are combinations. The product may be 2^32, but no hash is.
uint hash_color(uint color, uvec4 levels) {
    uint hash = level_of(color, 3u);
    hash = hash * levels.b + level_of(color, 2u);
    hash = hash * levels.g + level_of(color, 1u);
    return hash * levels.r + level_of(color, 0u);
}

// The quantised colour of a hash: the lowest codes of its levels.
uint color_of_hash(uint hash, uvec4 levels) {
    uint color = 0u;
    for (uint channel = 0u; channel < 4u; channel++) {
        uint level = hash % levels[channel];
        hash /= levels[channel];
        color |= quantiser[QUANTISER_FLOORS + channel * CODES + level] << 8u * channel;
    }
    return color;
}
#endif
