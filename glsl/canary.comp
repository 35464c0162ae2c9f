#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// Copies words and adds one, with an index offset that the host chooses. It exists for the canary tests: they leave out
// barriers or send it out of bounds and assert that the checks notice.
// Grid: one invocation per word.
#include "include/constants.glsl"

layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Source { uint source[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer Target { uint target[]; };

layout(push_constant, scalar) uniform CanaryPush {
    uint count;
    uint shift;
};

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < count) {
        target[i + shift] = source[i] + 1u;
    }
}
