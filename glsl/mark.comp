#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
// Mark: which voxels and cells have to do with the medium, for compact.comp's lists; counts the voxels with extinction.
// Grid: one invocation per cell, which counts for the voxel of the same index too; 8 x 8 x 1 workgroups.
#include "include/cell.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 0, binding = 1) uniform sampler3D field;
// As octants.comp wrote it.
layout(set = 0, binding = 2) uniform usampler3D emptiness;
// Bits 1 << LISTED_*; one texel more along every axis than the volume has voxels.
layout(set = 0, binding = 3, r32ui) writeonly uniform uimage3D marks;
// Word 0: voxels with extinction.
layout(set = 0, binding = 4, scalar) buffer Tally { uint tally[]; };

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    bool exists = all(lessThanEqual(at, ivec3(scene.dims)));
    uint bits = 0u;
    // Where even the neighbours of a macrocell are empty, two cells into every octant, nothing about its voxels has extinction.
    ivec3 macrocell = min(at, ivec3(scene.dims) - 1) / int(SKIP_SIZE);
    uint word = texelFetch(emptiness, macrocell, 0).r;
    bool is_far = ((word >> 1u | word >> 2u | word >> 3u) & 0x11111111u) == 0x11111111u;
    if (exists && !is_far) {
        for (uint n = 0u; n < 27u; n++) {
            ivec3 offset = ivec3(n % 3u, n / 3u % 3u, n / 9u) - 1;
            ivec3 voxel = at + offset;
            if (is_voxel(voxel) && texelFetch(field, voxel, 0).a > 0.0) {
                bits |= 1u << LISTED_NODES;
                bits |= offset == ivec3(0) ? 1u << LISTED_VOXELS : 0u;
                bits |= all(lessThanEqual(offset, ivec3(0))) ? 1u << LISTED_CELLS : 0u;
            }
        }
        bits &= is_voxel(at) ? ~0u : 1u << LISTED_CELLS;
    }
    uint found = subgroupAdd(bits >> LISTED_VOXELS & 1u);
    if (subgroupElect() && found > 0u) {
        atomicAdd(tally[0], found);
    }
    if (exists) {
        imageStore(marks, at, uvec4(bits));
    }
}
