#version 460
#extension GL_GOOGLE_include_directive : require
// Compact: the list of the marked blocks or cells of a range of linear indices, by one scan that reads the marks
// and writes the list (DESIGN section 2). The list keeps the order of the indices.
// Grid: one workgroup per tile of WORKGROUP * ROWS indices, any shape, tiles by take_tile.
#define STATUS_BINDING 4
#include "include/scene.glsl"
#include "include/tile_rows.glsl"

// What is listed: LISTED_*.
layout(constant_id = 5) const uint LISTED = LISTED_VOXELS;

// As mark.comp wrote them.
layout(set = 0, binding = 1) uniform usampler3D marks;
// Linear indices of the listed.
layout(set = 0, binding = 2, scalar) writeonly buffer ListItems { uint list_items[]; };
// Word LIST_COUNT: their number.
layout(set = 0, binding = 3, scalar) writeonly buffer ListHeader { uint list_header[]; };

layout(push_constant, scalar) uniform CompactPush {
    // First index and number of indices of the range.
    uint first;
    uint count;
    // As mark.comp.
    uint edge;
};

// Does no ray of the eye reach the cell's block, or one beside it?
bool is_remote(ivec3 cell, ivec3 counts) {
    ivec3 edge = ivec3(REACH_BLOCK);
    ivec3 low = max(cell / edge - 1, ivec3(0));
    ivec3 high = min(cell / edge + 1, (counts - 1) / edge);
    uint bits = 0u;
    for (int z = low.z; z <= high.z; z++) {
        for (int y = low.y; y <= high.y; y++) {
            for (int x = low.x; x <= high.x; x++) {
                bits |= texelFetch(marks, ivec3(x, y, z) * edge, 0).r;
            }
        }
    }
    return (bits >> MARK_REACHED & 1u) == 0u;
}

uint tile_item(uint index) {
    if (index >= count) {
        return 0u;
    }
    // Not a constant: reflection cannot evaluate operators on specialization constants.
    uint listed = LISTED;
    bool is_block = listed == LISTED_VOXELS || listed == LISTED_NODES;
    uvec3 counts = (scene.dims + edge - 1u) / edge + (is_block ? 0u : 1u);
    ivec3 at = from_linear(first + index, counts);
    uint bits = texelFetch(marks, at, 0).r;
    if (listed < LISTED_SEEN) {
        return bits >> listed & 1u;
    }
    bool is_cell = (bits >> LISTED_CELLS & 1u) != 0u;
    bool is_seen = (bits >> LISTED_SEEN & 1u) != 0u;
    if (!is_cell || is_seen != (listed == LISTED_SEEN)) {
        return 0u;
    }
    return uint(is_seen || is_remote(at, ivec3(counts)) == (listed == LISTED_REMOTE));
}

void main() {
    uint tile = take_tile(LOOKBACK_TICKET);
    uint tiles = (count + TILE - 1u) / TILE;
    if (tile >= tiles) {
        return;
    }
    uint is_listed[ROWS];
    uint before[ROWS];
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        is_listed[row] = tile_item(item_index(tile, row));
        before[row] = is_listed[row];
    }
    TileScan scan = scan_tile(tile, exclusive_rows(before));
    if (scan.stop) {
        return;
    }
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        if (is_listed[row] != 0u) {
            list_items[scan.before + before[row]] = first + item_index(tile, row);
        }
    }
    if (tile == tiles - 1u && linear_index() == 0u) {
        list_header[LIST_COUNT] = scan.inclusive;
    }
}
