// Copies words: the bar that memory-bound kernels are measured against (`tyndall bench scan`).
//
// Grid: one workgroup per WORKGROUP * ROWS * WIDTH words, any shape. No subgroup operations.
// Buffers: from -> to, in vectors of four words; WIDTH 1 copies them word by word.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 256, local_size_x_id = 0) in;
layout(constant_id = 0) const uint WORKGROUP = 256u;
layout(constant_id = 1) const uint ROWS = 4u;  // loads of an invocation that are under way together
layout(constant_id = 2) const uint WIDTH = 4u; // words per load: 1 or 4

layout(set = 0, binding = 0, std430) readonly buffer From { uvec4 from[]; };
layout(set = 0, binding = 1, std430) writeonly buffer To { uvec4 to[]; };

layout(push_constant, scalar) uniform BenchCopyPush {
    uint count; // words, a multiple of WIDTH
};

void main() {
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    uint first = group * WORKGROUP * ROWS + gl_LocalInvocationIndex;
    if (WIDTH == 1u) {
        uint row_values[ROWS];
        [[unroll]] for (uint row = 0u; row < ROWS; row++) {
            uint i = first + row * WORKGROUP;
            row_values[row] = i < count ? from[i / 4u][i % 4u] : 0u;
        }
        [[unroll]] for (uint row = 0u; row < ROWS; row++) {
            uint i = first + row * WORKGROUP;
            if (i < count) {
                to[i / 4u][i % 4u] = row_values[row];
            }
        }
    } else {
        uint vectors = count / 4u;
        uvec4 row_values[ROWS];
        [[unroll]] for (uint row = 0u; row < ROWS; row++) {
            uint i = first + row * WORKGROUP;
            row_values[row] = i < vectors ? from[i] : uvec4(0u);
        }
        [[unroll]] for (uint row = 0u; row < ROWS; row++) {
            uint i = first + row * WORKGROUP;
            if (i < vectors) {
                to[i] = row_values[row];
            }
        }
    }
}
