// Where each digit's keys begin: exclusive scan of every pass's histogram, written as the inclusive status words of the
// "tile -1" of that pass, so that look-back always ends there and needs no special case.
//
// A pass whose digit all keys share changes no order; it is told to copy. So is one where a digit is frequent.
//
// Grid: one workgroup per pass. Any subgroup size >= SUBGROUP_MIN.
// Buffers: histogram of radix_histogram.comp; status, see radix_onesweep.comp.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#define STATUS_BINDING 1
#include "include/tile_status.glsl"

layout(set = 0, binding = 0, scalar) readonly buffer Histogram { uint histogram[]; };

layout(push_constant, scalar) uniform RadixScanPush {
    uint rows; // status rows per pass: tiles + 1
};

const uint DIGITS_EACH = (RADIX_DIGITS + WORKGROUP - 1u) / WORKGROUP;

void main() {
    uint pass = gl_WorkGroupID.x;
    if (!subgroups_are_full()) {
        report_error(ERROR_SUBGROUPS);
        return;
    }
    uint first = linear_index() * DIGITS_EACH;
    uint sum = 0u;
    uint largest = 0u;
    for (uint i = 0u; i < DIGITS_EACH && first + i < RADIX_DIGITS; i++) {
        uint keys = histogram[pass * RADIX_DIGITS + first + i];
        sum += keys;
        largest = max(largest, keys);
    }
    uint all;
    uint start = workgroup_exclusive_add(sum, all);
    largest = workgroup_max(largest);
    if (linear_index() == 0u && largest > all / RADIX_FREQUENT) {
        status[RADIX_PASSES + pass] = largest == all ? RADIX_ALIKE : RADIX_SKEWED;
    }
    for (uint i = 0u; i < DIGITS_EACH && first + i < RADIX_DIGITS; i++) {
        publish_status(RADIX_HEAD + pass * rows * RADIX_DIGITS + first + i, STATE_INCLUSIVE, start);
        start += histogram[pass * RADIX_DIGITS + first + i];
    }
}
