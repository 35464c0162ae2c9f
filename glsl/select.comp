#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// Select: the items whose flag is not 0, in their order, by one scan that reads the flags and writes the items.
//
// Grid: one workgroup per tile of WORKGROUP * ROWS items, at least one, any shape, tiles by take_tile.
// Buffers: flags, items = input; selected = output (another buffer); totals[total_at] = how many there are.
#define ITEM_COUNT_BINDING 3
#define STATUS_BINDING 5
#include "include/item_count.glsl"
#include "include/tile_rows.glsl"

// Whether the items are their own indices; then `items` is not touched.
layout(constant_id = 5) const uint INDICES = 0u;

layout(set = 0, binding = 0, scalar) readonly buffer Flags { uint flags[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Items { uint items[]; };
layout(set = 0, binding = 2, scalar) writeonly buffer Selected { uint selected[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer Totals { uint totals[]; };

layout(push_constant, scalar) uniform SelectPush {
    uint count; // items, or COUNT_ON_DEVICE
    uint total_at;
};

uint tile_item(uint index) {
    return index < item_count(count) && flags[index] != 0u ? 1u : 0u;
}

void main() {
    uint tile = take_tile(LOOKBACK_TICKET);
    uint end = item_count(count);
    uint tiles = (end + TILE - 1u) / TILE;
    if (tile >= tiles) {
        if (end == 0u && tile == 0u && linear_index() == 0u) {
            totals[total_at] = 0u;
        }
        return;
    }
    uint is_selected[ROWS];
    uint before[ROWS];
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        is_selected[row] = tile_item(item_index(tile, row));
        before[row] = is_selected[row];
    }
    TileScan scan = scan_tile(tile, exclusive_rows(before));
    if (scan.stop) {
        return;
    }
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        if (is_selected[row] != 0u) {
            uint index = item_index(tile, row);
            selected[scan.before + before[row]] = INDICES != 0u ? index : items[index];
        }
    }
    if (tile == tiles - 1u && linear_index() == 0u) {
        totals[total_at] = scan.inclusive;
    }
}
