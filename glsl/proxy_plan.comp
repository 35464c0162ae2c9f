#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// After an attempt at compress 1: do the runs fit? If not, a coarser mask is tried (every channel loses its lowest kept
// bit; of an adaptive mask the tolerance doubles), else the attempts that follow become empty dispatches.
// Grid: one invocation.
#include "include/constants.glsl"

layout(local_size_x = 1) in;
layout(constant_id = 0) const bool ADAPTIVE = false;

layout(set = 0, binding = 0, scalar) buffer ProxyControl { uint proxy_control[]; };
// Workgroups of the next attempt and, from word 3 on, of its quantiser (indirect dispatches).
layout(set = 0, binding = 1, scalar) writeonly buffer Args { uint args[]; };

layout(push_constant, scalar) uniform ProxyPlanPush {
    uint capacity;
    // Workgroups of an attempt along x and y.
    uint groups_x;
    uint groups_y;
    // 1 before the first attempt: it is always made, with `mask`.
    uint is_start;
    // As PROXY_MASK.
    uint mask;
};

uint coarser_mask(uint kept) {
    if (ADAPTIVE) {
        return floatBitsToUint(max(2.0 * uintBitsToFloat(kept), ADAPTIVE_COARSER));
    }
    uint coarser = 0u;
    for (uint channel = 0u; channel < 32u; channel += 8u) {
        uint bits = kept >> channel & 0xFFu;
        coarser |= (bits == 0u ? 0u : bits & (bits - 1u)) << channel;
    }
    return coarser;
}

void main() {
    bool retry;
    if (is_start != 0u) {
        proxy_control[PROXY_MASK] = mask;
        retry = true;
    } else {
        retry = proxy_control[PROXY_RETRY] != 0u && proxy_control[PROXY_FOUND] > capacity;
        if (retry) {
            proxy_control[PROXY_MASK] = coarser_mask(proxy_control[PROXY_MASK]);
        } else {
            // Wraps to the largest word where every word may be a hash.
            uint last_hash = proxy_control[PROXY_LEVELS] * proxy_control[PROXY_LEVELS + 1u] *
                    proxy_control[PROXY_LEVELS + 2u] * proxy_control[PROXY_LEVELS + 3u] -
                1u;
            uint runs = proxy_control[PROXY_FOUND];
            proxy_control[PROXY_RUNS] = runs;
            proxy_control[PROXY_LATE_RUNS] = last_hash >> EARLY_BITS == 0u ? 0u : runs;
        }
    }
    proxy_control[PROXY_RETRY] = retry ? 1u : 0u;
    args[0] = retry ? groups_x : 0u;
    args[1] = groups_y;
    args[2] = 1u;
    args[3] = retry ? 4u : 0u; // channels
    args[4] = 1u;
    args[5] = 1u;
}
