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

layout(constant_id = 4) const uint VECTORS = 4u; // per invocation, at most 32 (FALLBACK_STEPS)
layout(constant_id = 5) const uint INCLUSIVE_SCAN = 0u;
// Whether the total is wanted. Then at least one workgroup runs.
layout(constant_id = 6) const uint TOTAL = 0u;
// Whether the buffers may end amid a vector.
layout(constant_id = 7) const uint ENDS_AMID = 0u;

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

// Subgroup k owns the k-th part of a tile, row by row.
uint vector_index(uint tile, uint row) {
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

uint tile_share(uint tile) {
    uint end = item_count(count);
    uint sum = 0u;
    [[unroll]] for (uint row = 0u; row < VECTORS; row++) {
        uvec4 loaded = load_items(vector_index(tile, row), end);
        sum += loaded.x + loaded.y + loaded.z + loaded.w;
    }
    return sum;
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
    uvec4 values[VECTORS];
    [[unroll]] for (uint row = 0u; row < VECTORS; row++) {
        values[row] = load_items(vector_index(tile, row), end);
    }
    uint before[VECTORS]; // sum of the subgroup's items before the vector
    uint sum = 0u;
    [[unroll]] for (uint row = 0u; row < VECTORS; row++) {
        uint own = values[row].x + values[row].y + values[row].z + values[row].w;
        uint inclusive = subgroupInclusiveAdd(own);
        before[row] = sum + inclusive - own;
        sum += subgroupBroadcast(inclusive, gl_SubgroupSize - 1u);
    }
    TileScan scan = scan_tile(tile, sum);
    if (scan.stop) {
        return;
    }
    [[unroll]] for (uint row = 0u; row < VECTORS; row++) {
        uint index = vector_index(tile, row);
        uvec4 value = values[row];
        uint x = scan.before + before[row];
        uvec4 result = uvec4(x, x + value.x, x + value.x + value.y, x + value.x + value.y + value.z);
        if (INCLUSIVE_SCAN != 0u) {
            result += value;
        }
        if (4u * index + 4u <= end) {
            sums[index] = result;
        } else {
            // Not one word more than was asked for.
            for (uint c = 0u; 4u * index + c < end && c < 4u; c++) {
                sum_words[4u * index + c] = result[c];
            }
        }
    }
    if (TOTAL != 0u && tile == tiles - 1u && linear_index() == 0u) {
        totals[total_at] = scan.inclusive;
    }
}
