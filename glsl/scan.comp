// Scan (prefix sum, modulo 2^32) of u32 items, in one pass or, see CARRY, in two.
//
// Grid: one workgroup per tile of WORKGROUP * VECTORS vectors of four items, any shape, tiles by take_tile. Any subgroup
// size >= SUBGROUP_MIN.
// Buffers: items = input, sums = output (another buffer), both in vectors of four items (the last may be cut, see ENDS_AMID);
// totals[total_at] = sum of all items, if TOTAL.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#define ITEM_COUNT_BINDING 2
#define STATUS_BINDING 3
#include "include/item_count.glsl"
#include "include/lookback.glsl"
#extension GL_EXT_control_flow_attributes : require

layout(constant_id = 4) const uint VECTORS = 4u; // per invocation, at most 32 (FALLBACK_STEPS); of a run SCAN_RUN_VECTORS times as many
layout(constant_id = 5) const uint INCLUSIVE_SCAN = 0u;
// Whether the total is wanted. Then at least one workgroup runs.
layout(constant_id = 6) const uint TOTAL = 0u;
// Whether the buffers may end amid a vector.
layout(constant_id = 7) const uint ENDS_AMID = 0u;
// Whether a lane owns a run of vectors (a blocked arrangement), instead of every so-manieth of its subgroup's (a striped one). For
// processors that stand in for a GPU: a lane's run stays in its cache, and the subgroup adds up once and not once per vector.
layout(constant_id = 8) const uint BLOCKED = 0u;

layout(set = 0, binding = 0, std430) readonly buffer Items { uvec4 items[]; };
layout(set = 0, binding = 0, scalar) readonly buffer ItemsWords { uint item_words[]; };
layout(set = 0, binding = 1, std430) writeonly buffer Sums { uvec4 sums[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer SumsWords { uint sum_words[]; };
layout(set = 0, binding = 5, scalar) writeonly buffer Totals { uint totals[]; };

layout(push_constant, scalar) uniform ScanPush {
    uint count; // items, or COUNT_ON_DEVICE
    uint total_at;
};

const uint TILE = WORKGROUP * VECTORS; // in vectors

// Subgroup k owns the k-th part of a tile: row by row, or lane by lane.
uint vector_index(uint tile, uint row) {
    if (BLOCKED != 0u) {
        return tile * TILE + linear_index() * VECTORS + row;
    }
    return tile * TILE + (gl_SubgroupID * VECTORS + row) * gl_SubgroupSize + gl_SubgroupInvocationID;
}

// The items of a vector, 0 beyond the end.
uvec4 load_items(uint index, uint end) {
    if (ENDS_AMID != 0u && 4u * index + 4u > end) {
        uvec4 cut = uvec4(0u);
        for (uint c = 0u; 4u * index + c < end && c < 4u; c++) {
            cut[c] = item_words[4u * index + c];
        }
        return cut;
    }
    uvec4 loaded = 4u * index < end ? items[index] : uvec4(0u);
    return mix(uvec4(0u), loaded, lessThan(4u * index + uvec4(0u, 1u, 2u, 3u), uvec4(end)));
}

uint sum_of(uvec4 value) {
    return value.x + value.y + value.z + value.w;
}

// The sums of a vector's items with `before` before them.
uvec4 sums_of(uvec4 value, uint before) {
    uvec4 exclusive = before + uvec4(0u, value.x, value.x + value.y, value.x + value.y + value.z);
    return INCLUSIVE_SCAN != 0u ? exclusive + value : exclusive;
}

// Of the vector that the end cuts, if it cuts one: not one word more than was asked for.
void store_cut(uvec4 result, uint end) {
    for (uint c = 0u; c < end % 4u; c++) {
        sum_words[end / 4u * 4u + c] = result[c];
    }
}

uint tile_share(uint tile) {
    uint end = item_count(count);
    uint sum = 0u;
    if (BLOCKED == 0u) {
        [[dont_unroll]] for (uint row = 0u; row < VECTORS; row++) {
            sum += sum_of(load_items(vector_index(tile, row), end));
        }
        return sum;
    }
    uint first = vector_index(tile, 0u);
    uint full = end / 4u; // vectors that the end does not cut
    [[dont_unroll]] for (uint row = 0u; row < VECTORS; row += SCAN_RUN_VECTORS) {
        [[unroll]] for (uint k = 0u; k < SCAN_RUN_VECTORS; k++) {
            uint index = first + row + k;
            if (index < full) {
                sum += sum_of(items[index]);
            }
        }
    }
    if (full - first < VECTORS) {
        sum += sum_of(load_items(full, end));
    }
    return sum;
}

// A tile whose items stay in registers. Sum of all items up to its end; `stop`: see scan_tile.
TileScan scan_rows(uint tile, uint end) {
    uvec4 values[VECTORS];
    [[unroll]] for (uint row = 0u; row < VECTORS; row++) {
        values[row] = load_items(vector_index(tile, row), end);
    }
    uint before[VECTORS]; // sum of the subgroup's items before the vector
    uint sum = 0u;
    [[unroll]] for (uint row = 0u; row < VECTORS; row++) {
        uint own = sum_of(values[row]);
        uint inclusive = subgroupInclusiveAdd(own);
        before[row] = sum + inclusive - own;
        sum += subgroupBroadcast(inclusive, gl_SubgroupSize - 1u);
    }
    TileScan scan = scan_tile(tile, sum);
    if (scan.stop) {
        return scan;
    }
    [[unroll]] for (uint row = 0u; row < VECTORS; row++) {
        uint index = vector_index(tile, row);
        uvec4 result = sums_of(values[row], scan.before + before[row]);
        if (4u * index + 4u <= end) {
            sums[index] = result;
        } else if (4u * index < end) {
            store_cut(result, end);
        }
    }
    return scan;
}

// A tile of which every lane has a run, read twice, the second time from a cache.
TileScan scan_runs(uint tile, uint end) {
    uint own = tile_share(tile);
    uint inclusive = subgroupInclusiveAdd(own);
    TileScan scan = scan_tile(tile, subgroupBroadcast(inclusive, gl_SubgroupSize - 1u));
    if (scan.stop) {
        return scan;
    }
    uint before = scan.before + inclusive - own;
    uint first = vector_index(tile, 0u);
    uint full = end / 4u; // vectors that the end does not cut
    [[dont_unroll]] for (uint row = 0u; row < VECTORS; row += SCAN_RUN_VECTORS) {
        [[unroll]] for (uint k = 0u; k < SCAN_RUN_VECTORS; k++) {
            uint index = first + row + k;
            if (index < full) {
                uvec4 value = items[index];
                sums[index] = sums_of(value, before);
                before += sum_of(value);
            }
        }
    }
    // Once, not per vector: where a processor stands in for a GPU, branches that no lane takes cost as much as those that all take.
    if (full - first < VECTORS) {
        store_cut(sums_of(load_items(full, end), before), end);
    }
    return scan;
}

void main() {
    uint tile = take_tile(LOOKBACK_TICKET);
    uint end = item_count(count);
    uint tiles = (end + 4u * TILE - 1u) / (4u * TILE);
    if (tile >= tiles) {
        if (TOTAL != 0u && end == 0u && tile == 0u && linear_index() == 0u) {
            totals[total_at] = 0u;
        }
        return;
    }
    TileScan scan;
    if (BLOCKED != 0u) {
        scan = scan_runs(tile, end);
    } else {
        scan = scan_rows(tile, end);
    }
    if (TOTAL != 0u && !scan.stop && tile == tiles - 1u && linear_index() == 0u) {
        totals[total_at] = scan.inclusive;
    }
}
