// Scan (prefix sum, modulo 2^32) of u32 items in one pass.
//
// Grid: one workgroup per tile of WORKGROUP * ROWS items, any shape, tiles by ticket. Any subgroup size >= SUBGROUP_MIN.
// Buffers: items = input, sums = output (another buffer), both in items.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#define ITEM_COUNT_BINDING 2
#define STATUS_BINDING 3
#include "include/item_count.glsl"
#include "include/tile_rows.glsl"

layout(constant_id = 5) const uint INCLUSIVE_SCAN = 0u;

layout(set = 0, binding = 0, scalar) readonly buffer Items { uint items[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer Sums { uint sums[]; };

layout(push_constant, scalar) uniform ScanPush {
    uint count; // items, or COUNT_ON_DEVICE
};

uint tile_item(uint index) {
    return index < item_count(count) ? items[index] : 0u;
}

void main() {
    uint tile = take_tile(LOOKBACK_TICKET);
    uint end = item_count(count);
    if (tile >= (end + TILE - 1u) / TILE) {
        return;
    }
    uint values[ROWS];
    uint before[ROWS];
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        values[row] = tile_item(item_index(tile, row));
        before[row] = values[row];
    }
    TileScan scan = scan_tile(tile, exclusive_rows(before));
    if (scan.failed) {
        return;
    }
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        uint index = item_index(tile, row);
        if (index < end) {
            sums[index] = scan.before + before[row] + (INCLUSIVE_SCAN != 0u ? values[row] : 0u);
        }
    }
}
