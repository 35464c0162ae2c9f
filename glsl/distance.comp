#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// Chebyshev distance of every macrocell to the nearest occupied one, one axis per dispatch: the maximum norm separates
// into minima of max(|i - j|, distance so far) along x, y and z.
// Grid: one invocation per cell, 4 x 4 x 4 workgroups.
#include "include/constants.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

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
    // At most 2 MAX_EMPTINESS + 1 iterations.
    uint nearest = 0xFFFFFFFFu;
    int low = max(cell[axis] - int(MAX_EMPTINESS), 0);
    int high = min(cell[axis] + int(MAX_EMPTINESS), cells[axis] - 1);
    for (int i = low; i <= high; i++) {
        ivec3 other = cell;
        other[axis] = i;
        nearest = min(nearest, max(uint(abs(i - cell[axis])), texelFetch(before, other, 0).r));
    }
    // Beyond the volume there is nothing: only what was looked at limits the distance.
    imageStore(after, cell, uvec4(min(nearest, MAX_EMPTINESS)));
}
