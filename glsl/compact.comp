#version 460
#extension GL_GOOGLE_include_directive : require
// Compact: the list of active voxels (σ_t > 0) of a range of linear voxel indices, by one look-back scan that reads the
// voxels and writes the list (DESIGN section 2). The list keeps the order of the indices.
// Grid: one workgroup per tile of WORKGROUP * ROWS voxels, any shape, tiles by ticket.
#define STATUS_BINDING 4
#include "include/scene.glsl"
#include "include/tile_rows.glsl"

layout(set = 0, binding = 1) uniform sampler3D field;
// Linear indices of the active voxels.
layout(set = 0, binding = 2, scalar) writeonly buffer ActiveVoxels { uint active_voxels[]; };
// Word LIST_COUNT: their number.
layout(set = 0, binding = 3, scalar) writeonly buffer ListHeader { uint list_header[]; };

layout(push_constant, scalar) uniform CompactPush {
    // First voxel and number of voxels of the range.
    uint first;
    uint count;
};

uint tile_item(uint index) {
    if (index >= count) {
        return 0u;
    }
    return texelFetch(field, ivec3(voxel_from_linear(first + index)), 0).a > 0.0 ? 1u : 0u;
}

void main() {
    uint tile = take_tile(LOOKBACK_TICKET);
    uint tiles = (count + TILE - 1u) / TILE;
    if (tile >= tiles) {
        return;
    }
    uint is_active[ROWS];
    uint before[ROWS];
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        is_active[row] = tile_item(item_index(tile, row));
        before[row] = is_active[row];
    }
    TileScan scan = scan_tile(tile, exclusive_rows(before));
    if (scan.failed) {
        return;
    }
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        if (is_active[row] != 0u) {
            active_voxels[scan.before + before[row]] = first + item_index(tile, row);
        }
    }
    if (tile == tiles - 1u && linear_index() == 0u) {
        list_header[LIST_COUNT] = scan.inclusive;
    }
}
