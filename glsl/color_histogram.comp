#version 460
#extension GL_GOOGLE_include_directive : require
// Histograms of the proxy's colours, from which an adaptive mask chooses its levels (quantiser.comp). The error of R, G or B
// counts as much as the voxel's opacity lets through of it, that of A as much as there is light. Empty voxels do not count.
// All numbers are integers, so that the order of the sums changes nothing.
// Grid: one workgroup per WORKGROUP * VOXELS voxels, any shape. No subgroup operations.
#include "include/scene.glsl"

layout(local_size_x = 256, local_size_x_id = 0) in;
layout(constant_id = 0) const uint WORKGROUP = 256u;
// Of an invocation. A workgroup sums up to WORKGROUP * VOXELS * CODE_SQUARE < 2^32.
layout(constant_id = 1) const uint VOXELS = 64u;

layout(set = 0, binding = 1) uniform usampler3D color;
// [row][code], sums of 64 bits in two words. Zero before the dispatch.
layout(set = 0, binding = 2, scalar) buffer ColorHistogram { uint color_histogram[]; };

layout(push_constant, scalar) uniform ColorHistogramPush {
    // Voxels of the volume.
    uint count;
};

shared uint bins[HISTOGRAM_ROWS * CODES];

void main() {
    for (uint i = gl_LocalInvocationIndex; i < HISTOGRAM_ROWS * CODES; i += WORKGROUP) {
        bins[i] = 0u;
    }
    barrier();

    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    // Groups beyond the last begin past the volume, which must not wrap around.
    uint first = min(group, count / (WORKGROUP * VOXELS) + 1u) * (WORKGROUP * VOXELS) + gl_LocalInvocationIndex;
    for (uint k = 0u; k < VOXELS; k++) {
        uint voxel = first + k * WORKGROUP;
        uint here = voxel < count ? texelFetch(color, voxel_from_linear(voxel), 0).r : 0u;
        if (here != 0u) {
            uvec4 code = uvec4(here, here >> 8u, here >> 16u, here >> 24u) & 0xFFu;
            uint opacity = code.a * code.a;
            uint light = (code.r * code.r + code.g * code.g + code.b * code.b) / 3u;
            // At least 1: a code that occurs has a weight.
            uint energy = max(light * light / CODE_SQUARE, 1u);
            atomicAdd(bins[code.r], opacity);
            atomicAdd(bins[CODES + code.g], opacity);
            atomicAdd(bins[2u * CODES + code.b], opacity);
            atomicAdd(bins[HISTOGRAM_ENERGY * CODES + code.a], energy);
            atomicAdd(bins[HISTOGRAM_LIGHT * CODES + code.a], light);
            atomicAdd(bins[HISTOGRAM_VOXELS * CODES + code.a], 1u);
        }
    }
    barrier();

    for (uint i = gl_LocalInvocationIndex; i < HISTOGRAM_ROWS * CODES; i += WORKGROUP) {
        uint sum = bins[i];
        if (sum != 0u) {
            uint before = atomicAdd(color_histogram[2u * i], sum);
            if (before + sum < before) {
                atomicAdd(color_histogram[2u * i + 1u], 1u);
            }
        }
    }
}
