#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// Distances by octant: how many macrocells a ray from this one may cross along each axis, this one included, where its
// direction lies in the octant: the edge of the largest empty cube that has this cell at its corner and extends that way.
// A ray that leaves a surface is not held up by what is behind it. Eight numbers of OCTANT_BITS bits in a word; bit a of
// an octant's number: towards larger indices along axis a.
// One axis per dispatch: the maximum norm separates into minima of max(|i - j|, distance so far) along x, y and z, j ahead.
// Grid: one invocation per cell, 4 x 4 x 4 workgroups.
#include "include/constants.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

// All bits of empty cells are set before the first axis.
layout(set = 0, binding = 0) uniform usampler3D before;
layout(set = 0, binding = 1, r32ui) writeonly uniform uimage3D after;

layout(push_constant, scalar) uniform DistancePush {
    // 0, 1, 2 = x, y, z.
    uint axis;
};

void main() {
    ivec3 cell = ivec3(gl_GlobalInvocationID);
    ivec3 cells = textureSize(before, 0);
    if (any(greaterThanEqual(cell, cells))) {
        return;
    }
    uint nearest[8];
    for (uint k = 0u; k < 8u; k++) {
        nearest[k] = MAX_OCTANT;
    }
    // 16 MAX_OCTANT iterations. Beyond the volume there is nothing: only what was looked at limits the distance.
    for (int d = 0; d < int(MAX_OCTANT); d++) {
        for (uint up = 0u; up < 2u; up++) {
            ivec3 other = cell;
            other[axis] += up == 1u ? d : -d;
            if (other[axis] >= 0 && other[axis] < cells[axis]) {
                uint word = texelFetch(before, other, 0).r;
                for (uint k = 0u; k < 8u; k++) {
                    uint found = max(uint(d), word >> OCTANT_BITS * k & MAX_OCTANT);
                    nearest[k] = (k >> axis & 1u) == up ? min(nearest[k], found) : nearest[k];
                }
            }
        }
    }
    uint word = 0u;
    for (uint k = 0u; k < 8u; k++) {
        word |= nearest[k] << OCTANT_BITS * k;
    }
    imageStore(after, cell, uvec4(word));
}
