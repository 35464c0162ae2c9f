// Histograms of all digits of the keys in one read: the first step of the radix sort.
//
// Grid: along x, as many workgroups as you like: they share the keys, WORKGROUP * RADIX_STEP_KEYS or a multiple of that each. None may
// get more than RADIX_STEPS_MAX times that. No subgroup operations.
// Buffers: keys = input, in vectors of four (the last may be cut, see ENDS_AMID);
//   histogram[pass * RADIX_DIGITS + digit] = count (zero before the dispatch).
// Shared memory: BINS counters per digit and pass.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_memory_scope_semantics : require

#define ITEM_COUNT_BINDING 2
#include "include/item_count.glsl"
#include "include/radix.glsl"

layout(local_size_x = 256, local_size_x_id = 0) in;
layout(constant_id = 0) const uint WORKGROUP = 256u;
const uint LOADS = RADIX_STEP_KEYS / 4u; // vectors of an invocation that are under way together
// What the keys are and their order, see radix.glsl.
layout(constant_id = 1) const uint KEY_KIND = KEY_U32;
layout(constant_id = 2) const uint DESCENDING = 0u;
// Whether the buffer of keys may end amid a vector.
layout(constant_id = 3) const uint ENDS_AMID = 0u;
// 1, or WORKGROUP for every invocation to have counters of its own: for processors that stand in for a GPU, where atomic operations of
// lanes follow one upon the other.
layout(constant_id = 4) const uint BINS = 1u;

layout(set = 0, binding = 0, std430) readonly buffer Keys { uvec4 keys[]; };
layout(set = 0, binding = 0, scalar) readonly buffer KeysWords { uint key_words[]; };
layout(set = 0, binding = 1, scalar) buffer Histogram { uint histogram[]; };

layout(push_constant, scalar) uniform RadixHistogramPush {
    uint count; // keys, or COUNT_ON_DEVICE
    uint bit_begin;
    uint bit_end;
    uint digit_bits; // of a pass
    uint passes;
};

shared uint bins[RADIX_PASSES * RADIX_DIGITS * BINS];

// The keys of a vector of which the first, 4 * i, exists.
uvec4 load_keys(uint i, uint end) {
    if (ENDS_AMID == 0u || 4u * i + 4u <= end) {
        return keys[i];
    }
    uvec4 loaded = uvec4(0u);
    for (uint c = 0u; 4u * i + c < end && c < 4u; c++) {
        loaded[c] = key_words[4u * i + c];
    }
    return loaded;
}

void count_key(uint key) {
    uint image = image_of_key(key, KEY_KIND, DESCENDING);
    for (uint pass = 0u; pass < passes; pass++) {
        uint digit = digit_in(digit_window(pass, bit_begin, bit_end, digit_bits), image);
        // A constant 1, in plain view: NVIDIA's compiler then adds once for all equal digits of a subgroup.
        atomicAdd(bins[pass * RADIX_DIGITS + digit], 1u, gl_ScopeWorkgroup, 0, 0);
    }
}

// Counts the invocation's keys, `steps` times LOADS vectors: a step's loads first.
void count_keys(uint first, uint steps, uint end) {
    for (uint step = 0u; step < steps; step++) {
        uvec4 loaded[LOADS];
        [[unroll]] for (uint k = 0u; k < LOADS; k++) {
            uint i = first + (step * LOADS + k) * WORKGROUP;
            loaded[k] = 4u * i < end ? load_keys(i, end) : uvec4(0u);
        }
        [[unroll]] for (uint k = 0u; k < LOADS; k++) {
            uint index = 4u * (first + (step * LOADS + k) * WORKGROUP);
            [[unroll]] for (uint c = 0u; c < 4u; c++) {
                if (index + c < end) {
                    count_key(loaded[k][c]);
                }
            }
        }
    }
}

void count_own_key(uint key) {
    uint image = image_of_key(key, KEY_KIND, DESCENDING);
    [[unroll]] for (uint pass = 0u; pass < RADIX_PASSES; pass++) {
        // Beyond the last pass nothing is left of the key, and nobody reads the count.
        uint digit = digit_in(digit_window(pass, bit_begin, bit_end, digit_bits), image);
        bins[(pass * RADIX_DIGITS + digit) * BINS + gl_LocalInvocationIndex]++;
    }
}

// The same where the invocation has counters of its own.
void count_own_keys(uint first, uint steps, uint end) {
    uint full = end / 4u; // vectors that the end does not cut
    [[dont_unroll]] for (uint k = 0u; k < steps * LOADS; k++) {
        uint i = first + k * WORKGROUP;
        if (i < full) {
            uvec4 loaded = keys[i];
            [[unroll]] for (uint c = 0u; c < 4u; c++) {
                count_own_key(loaded[c]);
            }
        } else if (i == full) {
            for (uint c = 0u; c < end % 4u; c++) {
                count_own_key(key_words[4u * full + c]);
            }
        }
    }
}

void main() {
    for (uint i = gl_LocalInvocationIndex; i < passes * RADIX_DIGITS * BINS; i += WORKGROUP) {
        bins[i] = 0u;
    }
    barrier();

    uint end = item_count(count);
    uint of_all = gl_NumWorkGroups.x * WORKGROUP * RADIX_STEP_KEYS; // keys of one step of all workgroups
    uint steps = (end + of_all - 1u) / of_all;
    uint first = gl_WorkGroupID.x * (steps * LOADS * WORKGROUP) + gl_LocalInvocationIndex; // vector
    if (BINS != 1u) {
        count_own_keys(first, steps, end);
    } else {
        count_keys(first, steps, end);
    }
    barrier();

    for (uint i = gl_LocalInvocationIndex; i < passes * RADIX_DIGITS; i += WORKGROUP) {
        uint keys_of_bin = 0u;
        for (uint k = 0u; k < BINS; k++) {
            keys_of_bin += bins[i * BINS + k];
        }
        if (keys_of_bin != 0u) {
            atomicAdd(histogram[i], keys_of_bin, gl_ScopeDevice, 0, 0);
        }
    }
}
