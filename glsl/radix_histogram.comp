// Histograms of all digits of the keys in one read: the first step of the radix sort.
//
// Grid: one workgroup per WORKGROUP * KEYS keys, any shape. No subgroup operations.
// Buffers: keys = input; histogram[pass * RADIX_DIGITS + digit] = count (zero before the dispatch).
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_KHR_memory_scope_semantics : require

#define ITEM_COUNT_BINDING 2
#include "include/item_count.glsl"
#include "include/radix.glsl"

layout(local_size_x = 256, local_size_x_id = 0) in;
layout(constant_id = 0) const uint WORKGROUP = 256u;
layout(constant_id = 1) const uint KEYS = 128u; // per invocation

layout(set = 0, binding = 0, scalar) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 1, scalar) buffer Histogram { uint histogram[]; };

layout(push_constant, scalar) uniform RadixHistogramPush {
    uint count; // keys, or COUNT_ON_DEVICE
    uint bit_begin;
    uint bit_end;
};

shared uint bins[RADIX_PASSES * RADIX_DIGITS];

void main() {
    uint passes = (bit_end - bit_begin + RADIX_BITS - 1u) / RADIX_BITS;
    for (uint i = gl_LocalInvocationIndex; i < passes * RADIX_DIGITS; i += WORKGROUP) {
        bins[i] = 0u;
    }
    barrier();

    uint end = item_count(count);
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    uint first = group * WORKGROUP * KEYS + gl_LocalInvocationIndex;
    for (uint i = 0u; i < KEYS && first + i * WORKGROUP < end; i++) {
        uint key = keys[first + i * WORKGROUP];
        for (uint pass = 0u; pass < passes; pass++) {
            uint digit = digit_of(key, pass, bit_begin, bit_end);
            atomicAdd(bins[pass * RADIX_DIGITS + digit], 1u, gl_ScopeWorkgroup, 0, 0);
        }
    }
    barrier();

    for (uint i = gl_LocalInvocationIndex; i < passes * RADIX_DIGITS; i += WORKGROUP) {
        if (bins[i] != 0u) {
            atomicAdd(histogram[i], bins[i], gl_ScopeDevice, 0, 0);
        }
    }
}
