// Histograms of all digits of the keys in one read: the first step of the radix sort.
//
// Grid: one workgroup per WORKGROUP * KEYS keys, any shape. No subgroup operations.
// Buffers: keys = input, in vectors of four; histogram[pass * RADIX_DIGITS + digit] = count (zero before the dispatch).
// Shared memory: PARTS words per digit.
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
layout(constant_id = 1) const uint KEYS = 128u; // per invocation, a multiple of 4 * LOADS
// Counters per digit, for neighbouring invocations: those of one subgroup that count the same digit wait for each other.
layout(constant_id = 2) const uint PARTS = 1u;
const uint LOADS = 4u; // vectors of an invocation that are under way together

layout(set = 0, binding = 0, std430) readonly buffer Keys { uvec4 keys[]; };
layout(set = 0, binding = 1, scalar) buffer Histogram { uint histogram[]; };

layout(push_constant, scalar) uniform RadixHistogramPush {
    uint count; // keys, or COUNT_ON_DEVICE
    uint bit_begin;
    uint bit_end;
};

shared uint bins[RADIX_PASSES * RADIX_DIGITS * PARTS];

void count_key(uint key, uint passes) {
    uint part = gl_LocalInvocationIndex % PARTS;
    for (uint pass = 0u; pass < passes; pass++) {
        uint digit = digit_of(key, pass, bit_begin, bit_end);
        atomicAdd(bins[(pass * RADIX_DIGITS + digit) * PARTS + part], 1u, gl_ScopeWorkgroup, 0, 0);
    }
}

void main() {
    uint passes = (bit_end - bit_begin + RADIX_BITS - 1u) / RADIX_BITS;
    for (uint i = gl_LocalInvocationIndex; i < passes * RADIX_DIGITS * PARTS; i += WORKGROUP) {
        bins[i] = 0u;
    }
    barrier();

    uint end = item_count(count);
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    uint first = group * (WORKGROUP * KEYS / 4u) + gl_LocalInvocationIndex; // vector
    for (uint step = 0u; step < KEYS / 4u; step += LOADS) {
        uvec4 loaded[LOADS];
        [[unroll]] for (uint k = 0u; k < LOADS; k++) {
            uint i = first + (step + k) * WORKGROUP;
            loaded[k] = 4u * i < end ? keys[i] : uvec4(0u);
        }
        [[unroll]] for (uint k = 0u; k < LOADS; k++) {
            uint index = 4u * (first + (step + k) * WORKGROUP);
            [[unroll]] for (uint c = 0u; c < 4u; c++) {
                if (index + c < end) {
                    count_key(loaded[k][c], passes);
                }
            }
        }
    }
    barrier();

    for (uint i = gl_LocalInvocationIndex; i < passes * RADIX_DIGITS; i += WORKGROUP) {
        uint sum = 0u;
        for (uint part = 0u; part < PARTS; part++) {
            sum += bins[i * PARTS + part];
        }
        if (sum != 0u) {
            atomicAdd(histogram[i], sum, gl_ScopeDevice, 0, 0);
        }
    }
}
