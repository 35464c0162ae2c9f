#version 460
#extension GL_GOOGLE_include_directive : require
// What a proxy ray reads of a bucket, computed once per bucket: mean source function and extinction.
// Grid: one invocation per bucket (indirect).
#define ITEM_COUNT_BINDING 4
#define QUANTISER_BINDING 2
#include "include/color_code.glsl"
#include "include/item_count.glsl"
#include "include/proxy.glsl"

layout(local_size_x_id = 0) in;

layout(set = 0, binding = 1, scalar) readonly buffer BucketColor { uint bucket_color[]; };
layout(set = 0, binding = 3, scalar) readonly buffer SourceMax { uint source_max[]; };
// Two half floats: source function times radiance_scale, extinction / max_extinction.
layout(set = 0, binding = 5, scalar) writeonly buffer BucketLight { uint bucket_light[]; };

layout(push_constant, scalar) uniform BucketLightPush {
    // COUNT_ON_DEVICE.
    uint count;
};

void main() {
    uint i = gl_GlobalInvocationID.x + gl_GlobalInvocationID.y * gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    if (i < item_count(count)) {
        float most = uintBitsToFloat(source_max[0]);
        uint color = bucket_color[i];
        vec4 value;
        for (uint channel = 0u; channel < 4u; channel++) {
            uint code = code_of(color, channel);
            value[channel] = uintBitsToFloat(quantiser[QUANTISER_VALUES + channel * CODES + code]);
        }
        bucket_light[i] = packHalf2x16(decode_color(color, value, most));
    }
}
