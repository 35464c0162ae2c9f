// From which of its cell's points each direction of a gather is followed (src/passes/points.rs): eight to a word, even directions
// first, then those that are aimed at the eye. Each is a point, and in the fourth bit whether it has more directions than others.
// The including kernel defines POINTS_BINDING.
#ifndef POINTS_GLSL
#define POINTS_GLSL
#include "constants.glsl"

layout(set = 0, binding = POINTS_BINDING, scalar) readonly buffer Points { uint points[]; };

struct Dealt {
    uint point;
    // Of the direction, over that of the mean of all.
    float weight;
};

// What direction `slot` of `count` got. `flip` (0 to 7, random) makes every point equally likely. Where every point has a direction,
// all points weigh the same, though some have one more: else what is the same everywhere would come out uneven.
Dealt dealt_to(uint slot, uint count, bool is_aimed, uint flip) {
    uint at = slot + (is_aimed ? (count + CELL_POINTS - 1u) / CELL_POINTS * CELL_POINTS : 0u);
    uint dealt = points[at / CELL_POINTS] >> 4u * (at % CELL_POINTS);
    uint half_count = slot < count / 2u ? count / 2u : count - count / 2u;
    uint of = is_aimed ? half_count : count;
    uint each = of / CELL_POINTS + (dealt >> 3u & 1u);
    float weight = of < CELL_POINTS ? 1.0 : float(of) / float(CELL_POINTS * each);
    return Dealt((dealt & 7u) ^ flip, weight);
}
#endif
