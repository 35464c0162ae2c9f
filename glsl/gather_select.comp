#version 460
#extension GL_GOOGLE_include_directive : require
// Gather, step 2: which candidates are traced, and with what weight (DESIGN section 2, "Choosing directions").
//   resample: p_i = (1−β) w_i/Σw + β/M, a systematic draw with hits n_i, E n_i = N p_i; weight n_i/(M N p_i).
//     Grid: x = cells of the chunk, one each.
//   top: the N largest, weight 1/N (biased, as in the paper). Grid: x = cells of the chunk, y = candidates: every
//     candidate finds its own rank, so that no invocation loops more than M times.
#define LIST_BINDING 1
#include "include/list.glsl"
#include "include/gather.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint SAMPLING = SAMPLING_RESAMPLE;

// [candidate][item of the chunk]
layout(set = 0, binding = 3, scalar) readonly buffer Weights { float weights[]; };
// [slot][item of the chunk]: x = candidate, y = bits of its weight; weight 0 = nothing in the slot.
layout(set = 0, binding = 4, scalar) writeonly buffer Chosen { uvec2 chosen[]; };

layout(push_constant, scalar) uniform GatherSelectPush {
    uint chunk_begin;
    uint chunk_items;
    uint order;
    uint candidates;
    uint directions;
    // β
    float defence;
};

float weight_of(uint candidate, uint item) {
    return weights[candidate * chunk_items + item];
}

void main() {
    uint item = gl_GlobalInvocationID.x;
    if (item >= items_in_chunk(chunk_begin, chunk_items)) {
        return;
    }
    if (SAMPLING == SAMPLING_TOP) {
        uint own = gl_GlobalInvocationID.y;
        float w = weight_of(own, item);
        uint rank = 0u;
        for (uint c = 0u; c < candidates; c++) {
            float other = weight_of(c, item);
            rank += other > w || (other == w && c < own) ? 1u : 0u;
        }
        if (rank < directions) {
            chosen[rank * chunk_items + item] = uvec2(own, floatBitsToUint(1.0 / float(directions)));
        }
        return;
    }
    float sum = 0.0;
    for (uint c = 0u; c < candidates; c++) {
        sum += weight_of(c, item);
    }
    uint index = list_items[chunk_begin + item];
    float u = draw_shift(stream_key(index, order, scene.seed_low, scene.seed_high));
    float m = float(candidates);
    float n = float(directions);
    // Systematic draw: candidate c is hit once for every integer in (below, above], the interval of its share n p.
    float above = u;
    uint slot = 0u;
    for (uint c = 0u; c < candidates; c++) {
        float p = sum > 0.0 ? (1.0 - defence) * (weight_of(c, item) / sum) + defence / m : 1.0 / m;
        float below = above;
        // The last share ends at n + u whatever the rounding, so that exactly n hits are made.
        above = c + 1u == candidates ? n + u : above + n * p;
        uint hits = uint(max(0.0, floor(above) - floor(below)));
        if (hits > 0u && slot < directions) {
            chosen[slot * chunk_items + item] = uvec2(c, floatBitsToUint(float(hits) / (m * n * p)));
            slot++;
        }
    }
    for (; slot < directions; slot++) {
        chosen[slot * chunk_items + item] = uvec2(0u);
    }
}
