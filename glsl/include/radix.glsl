// What the kernels of the radix sort share: digits of a key.
#ifndef RADIX_GLSL
#define RADIX_GLSL
#include "constants.glsl"

// Bits of a key that pass `pass` sorts by: the window [bit_begin, bit_end) in steps of RADIX_BITS; the last may be
// narrower.
// First bit and width.
uvec2 digit_window(uint pass, uint bit_begin, uint bit_end) {
    uint shift = bit_begin + pass * RADIX_BITS;
    return uvec2(shift, min(bit_end - shift, RADIX_BITS));
}

uint digit_in(uvec2 window, uint key) {
    return bitfieldExtract(key, int(window.x), int(window.y));
}

uint digit_of(uint key, uint pass, uint bit_begin, uint bit_end) {
    return digit_in(digit_window(pass, bit_begin, bit_end), key);
}
#endif
