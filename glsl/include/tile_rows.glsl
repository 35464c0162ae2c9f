// Scan of one value per item: the plain way to use lookback.glsl.
//
// A tile is TILE = WORKGROUP * ROWS consecutive items. Subgroup k owns the k-th part of WORKGROUP * ROWS / subgroups
// items, row by row: in row r, lane l has item `item_index(tile, r)`, so that loads and stores are coalesced.
//
// Contract. Specialization ids 0 to 4 are taken. The including kernel defines STATUS_BINDING and
//     uint tile_item(uint index)    // value of item `index`, 0 beyond the end; recomputable, see lookback.glsl
// and in main():
//     uint tile = take_tile(LOOKBACK_TICKET);
//     if (tile >= (count + TILE - 1u) / TILE) return;
//     uint before[ROWS];
//     for (uint row = 0u; row < ROWS; row++) before[row] = tile_item(item_index(tile, row));
//     TileScan scan = scan_tile(tile, exclusive_rows(before));
//     if (scan.stop) return;
//     // sum of all items before item_index(tile, row) = scan.before + before[row]; of all up to the tile's end =
//     // scan.inclusive
#ifndef TILE_ROWS_GLSL
#define TILE_ROWS_GLSL
#extension GL_EXT_control_flow_attributes : require
#include "lookback.glsl"

layout(constant_id = 4) const uint ROWS = 16u; // at most 32, see tile_share's contract
const uint TILE = WORKGROUP * ROWS;

uint tile_item(uint index);

uint item_index(uint tile, uint row) {
    return tile * TILE + (gl_SubgroupID * ROWS + row) * gl_SubgroupSize + gl_SubgroupInvocationID;
}

uint tile_share(uint tile) {
    uint sum = 0u;
    // Hardly ever run; but lavapipe goes through an iteration of what it leaves out.
    [[dont_unroll]] for (uint row = 0u; row < ROWS; row++) {
        sum += tile_item(item_index(tile, row));
    }
    return sum;
}

// Replaces each value by the sum of those before it in the subgroup's part; returns the sum of all of them.
uint exclusive_rows(inout uint values[ROWS]) {
    uint sum = 0u;
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        uint inclusive = subgroupInclusiveAdd(values[row]);
        values[row] = sum + inclusive - values[row];
        sum += subgroupBroadcast(inclusive, gl_SubgroupSize - 1u);
    }
    return sum;
}
#endif
