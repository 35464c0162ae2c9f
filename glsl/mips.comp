#version 460
#extension GL_GOOGLE_include_directive : require
// Mips: means of source and extinction over voxels and blocks of voxels, for rays that need no detail. A voxel's mean is
// not its centre's value: where the medium is dense, most light comes from between the centres, and from where only a
// neighbour has extinction.
// Grid: one invocation per block, 4 x 4 x 4 workgroups.
#include "include/constants.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

// Blocks of 2^LEVEL voxels along their edge, made from those of the level before.
layout(constant_id = 0) const uint LEVEL = 0u;
// Somebody reads `values`.
layout(constant_id = 1) const bool HAS_VALUES = true;

// Rgb = source function, and for level 2: times extinction; a = extinction. For level 0: the source.
layout(set = 0, binding = 1) uniform sampler3D before;
// Two half floats: source function (mean of the channels), extinction.
layout(set = 0, binding = 2, r32ui) writeonly uniform uimage3D values;
// Rgb = source function, from level 1 on times extinction, so that it can be interpolated; a = extinction.
layout(set = 0, binding = 3, rgba16f) writeonly uniform image3D means;
// By macrocells: 0 where the source may have extinction, for a sample within the cell.
layout(set = 0, binding = 4) uniform usampler3D emptiness;

// Product and extinction.
vec4 product(vec4 f) {
    return LEVEL == 2u ? f : vec4(f.rgb * f.a, f.a);
}

void main() {
    ivec3 block = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(block, imageSize(means)))) {
        return;
    }
    // Most of a volume is empty. Macrocells are workgroups of level 0, so that all invocations of one agree; and a loop of no
    // iterations is skipped where a branch may not be (lavapipe).
    bool is_empty = LEVEL == 0u && texelFetch(emptiness, block / int(SKIP_SIZE), 0).r != 0u;
    uint octants = is_empty ? 0u : 8u;
    vec4 sum = vec4(0.0);
    float parts = 0.0;
    for (uint k = 0u; k < octants; k++) {
        ivec3 part = 2 * block + ivec3(k & 1u, k >> 1u & 1u, k >> 2u);
        if (LEVEL == 0u) {
            // The middle of one of the voxel's octants.
            sum += product(textureLod(before, (vec3(part) + 0.5) / vec3(2 * imageSize(means)), 0.0));
            parts += 1.0;
        } else if (all(lessThan(part, textureSize(before, 0)))) {
            sum += product(texelFetch(before, part, 0));
            parts += 1.0;
        }
    }
    vec4 mean = sum / max(parts, 1.0);
    vec3 light = mean.a > 0.0 ? mean.rgb / mean.a : vec3(0.0);
    if (HAS_VALUES) {
        imageStore(values, block, uvec4(packHalf2x16(vec2(dot(light, vec3(1.0 / 3.0)), mean.a))));
    }
    imageStore(means, block, LEVEL == 0u ? vec4(light, mean.a) : mean);
}
