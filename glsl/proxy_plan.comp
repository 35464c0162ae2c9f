#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// After an attempt at compress 1: do the runs fit? If not, a coarser mask is tried (every channel loses its lowest kept
// bit), else the attempts that follow become empty dispatches. Grid: one invocation.
#include "include/constants.glsl"

layout(set = 0, binding = 0, scalar) buffer ProxyControl { uint proxy_control[]; };
// Workgroups of the next attempt (an indirect dispatch).
layout(set = 0, binding = 1, scalar) writeonly buffer Args { uint args[]; };

layout(push_constant, scalar) uniform ProxyPlanPush {
    uint capacity;
    // Workgroups of an attempt along x and y.
    uint groups_x;
    uint groups_y;
    // 1 before the first attempt: it is always made, with `mask`.
    uint is_start;
    uint mask;
};

void main() {
    bool retry;
    if (is_start != 0u) {
        proxy_control[PROXY_MASK] = mask;
        retry = true;
    } else {
        retry = proxy_control[PROXY_RETRY] != 0u && proxy_control[PROXY_FOUND] > capacity;
        if (retry) {
            uint kept = proxy_control[PROXY_MASK];
            uint coarser = 0u;
            for (uint channel = 0u; channel < 32u; channel += 8u) {
                uint bits = kept >> channel & 0xFFu;
                coarser |= (bits == 0u ? 0u : bits & (bits - 1u)) << channel;
            }
            proxy_control[PROXY_MASK] = coarser;
        } else {
            proxy_control[PROXY_RUNS] = proxy_control[PROXY_FOUND];
        }
    }
    proxy_control[PROXY_RETRY] = retry ? 1u : 0u;
    args[0] = retry ? groups_x : 0u;
    args[1] = groups_y;
    args[2] = 1u;
}
