// Scan over tiles for any kernel, in a single pass: decoupled look-back with fallback (Merrill and Garland 2016; the
// fallback after Smith, Levien and Owens, "Decoupled Fallback", 2025); or by three dispatches, see CARRY. Sums are exact
// modulo 2^32, and the same both ways.
//
// Contract. The including kernel
//   1. defines STATUS_BINDING, which with the next binding holds `status` (LOOKBACK_HEAD + 2 words per tile, zero before
//      the dispatch) and `diagnostics` (see tile_status.glsl);
//   2. defines `uint tile_share(uint tile)`: this invocation's share of the sum of any tile's values, recomputed from
//      inputs that the dispatch does not change (so a scan is never in place). Any partition of the tile over the
//      workgroup will do. At most 32 loop iterations, no barrier. Items beyond the end count 0;
//   3. calls, with the whole workgroup in uniform control flow,
//         uint tile = take_tile(LOOKBACK_TICKET);   // any grid shape with at least as many workgroups as tiles
//         if (tile >= tiles) return;
//      computes its values, with subgroup k owning the k-th part of the tile, and their sum over the subgroup, then
//         TileScan scan = scan_tile(tile, subgroup_sum);
//         if (scan.stop) return;                    // failed and reported, or CARRY_COUNT: nothing may be written
//      scan.before = sum of all values before this subgroup's first one; scan.inclusive = sum of all up to the tile's
//      end, in the last tile the grand total.
// Kernels with one value per item find the rest in tile_rows.glsl.
//
// A 32-bit sum is kept in two status words of 16 bits, each with its state; a reader accepts them when the states
// agree. Both halves then come from the same state, hence from the same sum, without 64-bit atomics.
#ifndef LOOKBACK_GLSL
#define LOOKBACK_GLSL
#include "tile_status.glsl"

struct TileScan {
    uint before;
    uint inclusive;
    bool stop;
};

uint tile_share(uint tile);

shared uint shared_next;
shared uint shared_exclusive;

void publish_sum(uint tile, uint state, uint sum) {
    publish_status(LOOKBACK_HEAD + 2u * tile, state, sum & 0xFFFFu);
    publish_status(LOOKBACK_HEAD + 2u * tile + 1u, state, sum >> 16u);
}

// State of a tile; `sum` is meaningful unless it is STATE_NONE.
uint load_sum(uint tile, out uint sum) {
    uint low = load_status(LOOKBACK_HEAD + 2u * tile);
    uint high = load_status(LOOKBACK_HEAD + 2u * tile + 1u);
    sum = (low & 0xFFFFu) | (high << 16u);
    return low >> STATE_SHIFT == high >> STATE_SHIFT ? low >> STATE_SHIFT : STATE_NONE;
}

// Walks back from tile `next` - 1 with one subgroup, a lane per tile, adding to `exclusive`. Returns when an inclusive
// sum (or the beginning) was found: `next` = 0; when tile `next` - 1 stayed missing for SPIN_LIMIT polls; or when
// `steps` reached the budget.
void walk_back(inout uint next, inout uint exclusive, inout uint steps, inout uint spins) {
    uint polls = 0u;
    while (next > 0u && polls <= SPIN_LIMIT && steps < LOOKBACK_BUDGET) {
        uint lane = gl_SubgroupInvocationID;
        uint state = STATE_INCLUSIVE; // before the first tile: nothing, completely known
        uint sum = 0u;
        if (lane < next) {
            state = load_sum(next - 1u - lane, sum);
        }
        uint inclusive = subgroupMin(state == STATE_INCLUSIVE ? lane : gl_SubgroupSize);
        uint missing = subgroupMin(state == STATE_NONE ? lane : gl_SubgroupSize);
        uint known = min(inclusive + 1u, missing); // lanes to add; SIZE + 1 when all are READY
        exclusive += subgroupAdd(lane < known ? sum : 0u);
        if (inclusive < missing) {
            next = 0u;
        } else {
            next -= missing;
            // The count of polls starts again with each tile waited for.
            polls = missing == 0u ? polls + 1u : missing < gl_SubgroupSize ? 1u : 0u;
            spins += missing < gl_SubgroupSize ? 1u : 0u;
        }
        steps++;
    }
}

// scan_tile without look-back: writes the tile's sum for column_scan.comp, or reads what that has made of it.
TileScan scan_tile_by_dispatches(uint tile, uint subgroup_sum) {
    TileScan scan;
    uint tile_sum;
    scan.before = exclusive_add_over_subgroups(subgroup_sum, tile_sum);
    scan.inclusive = tile_sum;
    scan.stop = CARRY == CARRY_COUNT;
    if (CARRY == CARRY_GIVEN) {
        uint exclusive = status[LOOKBACK_HEAD + tile];
        scan.before += exclusive;
        scan.inclusive += exclusive;
    } else if (linear_index() == 0u) {
        status[LOOKBACK_HEAD + tile] = tile_sum;
    }
    return scan;
}

TileScan scan_tile(uint tile, uint subgroup_sum) {
    if (CARRY != CARRY_LOOK_BACK) {
        return scan_tile_by_dispatches(tile, subgroup_sum);
    }
    TileScan scan;
    uint tile_sum;
    scan.before = exclusive_add_over_subgroups(subgroup_sum, tile_sum);
    bool leader = linear_index() == 0u;
    if (leader && may_publish(tile)) {
        publish_sum(tile, tile == 0u ? STATE_INCLUSIVE : STATE_READY, tile_sum);
    }

    // Subgroup 0 walks, all meet for the fallback. `next`, `exclusive` and the counters are subgroup 0's;
    // shared_next carries the decision to the others.
    uint next = tile;
    uint exclusive = 0u;
    uint steps = 0u;
    uint spins = 0u;
    uint fallbacks = 0u;
    for (;;) {
        if (gl_SubgroupID == 0u) {
            walk_back(next, exclusive, steps, spins);
            if (leader && next == 0u && tile != 0u && may_publish(tile)) {
                publish_sum(tile, STATE_INCLUSIVE, exclusive + tile_sum); // at once: others wait for it
            }
            if (leader) {
                shared_next = next == 0u || steps < LOOKBACK_BUDGET ? next : NO_TILE;
                shared_exclusive = exclusive;
            }
        }
        barrier();
        uint blocking = shared_next;
        if (blocking == 0u || blocking == NO_TILE) {
            break;
        }
        // workgroup_add's barriers also keep shared_next until all have read it.
        uint sum = workgroup_add(tile_share(blocking - 1u));
        if (leader) {
            publish_sum(blocking - 1u, STATE_READY, sum);
        }
        // No need to read it back: progress does not depend on what others see.
        exclusive += sum;
        next = blocking - 1u;
        steps += FALLBACK_STEPS;
        fallbacks++;
    }

    scan.stop = shared_next == NO_TILE;
    exclusive = shared_exclusive;
    if (leader) {
        report_lookback(spins, fallbacks);
        if (scan.stop) {
            report_error(ERROR_BUDGET);
        }
    }
    scan.before += exclusive;
    scan.inclusive = exclusive + tile_sum;
    return scan;
}
#endif
