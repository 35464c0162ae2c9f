// What the kernels of the gather share: the random numbers of a cell, by the key of its stream.
#ifndef GATHER_GLSL
#define GATHER_GLSL
#include "rng.glsl"
#include "constants.glsl"

// Shift of the lattice of the traced directions, or of the candidates that they are chosen from.
vec2 lattice_shift(uint key) {
    return vec2(random_float(key, 0u), random_float(key, 1u));
}

// The number that gather_select.comp draws by.
float draw_shift(uint key) {
    return random_float(key, 2u);
}

// `flip` of cell.glsl's point_of_sample.
uint point_flip(uint key) {
    return uint(random_float(key, 3u) * float(CELL_POINTS));
}

// Shift of the lattice of directions that SAMPLING_RESIDUAL follows in the proxy alone. It has nothing to do with that of the
// traced ones: then the mean of a product is the product of means, and what both levels get wrong does not add up.
vec2 base_shift(uint key) {
    return vec2(random_float(key, 4u), random_float(key, 5u));
}
#endif
