// What the kernels of the radix sort share: digits of a key, and keys of other kinds as words that are in their order.
#ifndef RADIX_GLSL
#define RADIX_GLSL
#include "constants.glsl"

// Bits of a key that pass `pass` sorts by: the window [bit_begin, bit_end) in steps of digit_bits <= RADIX_BITS; the last
// may be narrower, down to no bit at all.
// First bit and width.
uvec2 digit_window(uint pass, uint bit_begin, uint bit_end, uint digit_bits) {
    uint shift = min(bit_begin + pass * digit_bits, bit_end);
    return uvec2(shift, min(bit_end - shift, digit_bits));
}

uint digit_in(uvec2 window, uint key) {
    return bitfieldExtract(key, int(window.x), int(window.y));
}

// The word by which a key of this kind is sorted: words in ascending order are keys in the order asked for. An f32 with
// its sign set counts down as its bits count up, so all its bits turn; else only the sign does.
uint image_of_key(uint key, uint kind, uint descending) {
    if (kind == KEY_I32) {
        key ^= 0x80000000u;
    } else if (kind == KEY_F32) {
        key ^= key >> 31u != 0u ? 0xFFFFFFFFu : 0x80000000u;
    }
    // Not a pass backwards, which would turn equal keys round as well.
    return descending != 0u ? ~key : key;
}

// Its inverse.
uint key_of_image(uint image, uint kind, uint descending) {
    uint key = descending != 0u ? ~image : image;
    if (kind == KEY_I32) {
        key ^= 0x80000000u;
    } else if (kind == KEY_F32) {
        key ^= key >> 31u != 0u ? 0x80000000u : 0xFFFFFFFFu;
    }
    return key;
}
#endif
