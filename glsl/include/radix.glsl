// What the kernels of the radix sort share: digits of a key.
#ifndef RADIX_GLSL
#define RADIX_GLSL
#include "constants.glsl"

// Bits of a key that pass `pass` sorts by: the window [bit_begin, bit_end) in steps of RADIX_BITS; the last may be
// narrower.
uint digit_of(uint key, uint pass, uint bit_begin, uint bit_end) {
    uint shift = bit_begin + pass * RADIX_BITS;
    return bitfieldExtract(key, int(shift), int(min(bit_end - shift, RADIX_BITS)));
}
#endif
