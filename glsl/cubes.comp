#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// Cubes: for every voxel the largest aligned cube of 2^level voxels along its edge that holds one value only. Cubes that
// reach beyond the grid hold what is inside.
// Grid: one invocation per voxel, or per cube of `level` for CUBES_MERGE; 4 x 4 x 4 workgroups.
#include "include/constants.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

// CUBES_*.
layout(constant_id = 0) const uint STAGE = CUBES_COPY;

layout(set = 0, binding = 0) uniform usampler3D values;
// Value and level << CUBES_VALUE_BITS; of a merged cube at its lowest voxel.
layout(set = 0, binding = 1, r32ui) uniform uimage3D merged;
layout(set = 0, binding = 2, r32ui) writeonly uniform uimage3D cubes;

layout(push_constant, scalar) uniform CubesPush {
    // Level that is made; the largest one, when it is spread.
    uint level;
};

bool is_inside(ivec3 voxel) {
    return all(lessThan(voxel, textureSize(values, 0)));
}

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    if (STAGE == CUBES_COPY) {
        if (is_inside(at)) {
            imageStore(merged, at, uvec4(texelFetch(values, at, 0).r));
        }
    } else if (STAGE == CUBES_MERGE) {
        ivec3 low = at << level;
        if (!is_inside(low)) {
            return;
        }
        uint first = imageLoad(merged, low).r;
        bool is_one = first >> CUBES_VALUE_BITS == level - 1u;
        for (uint k = 1u; k < 8u; k++) {
            ivec3 child = low + (ivec3(k & 1u, k >> 1u & 1u, k >> 2u) << (level - 1u));
            is_one = is_one && (!is_inside(child) || imageLoad(merged, child).r == first);
        }
        if (is_one) {
            imageStore(merged, low, uvec4(first + (1u << CUBES_VALUE_BITS)));
        }
    } else if (is_inside(at)) {
        uint word = imageLoad(merged, at).r & (1u << CUBES_VALUE_BITS) - 1u;
        uint found = 0u;
        for (uint l = 1u; l <= level; l++) {
            found = imageLoad(merged, at >> l << l).r >> CUBES_VALUE_BITS >= l ? l : found;
        }
        imageStore(cubes, at, uvec4(word | found << CUBES_VALUE_BITS));
    }
}
