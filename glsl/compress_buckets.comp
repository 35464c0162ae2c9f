#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// Compress 2: runs sorted by hash -> buckets. Equal hashes are merged: bucketColor, hashValue and bucketSize per bucket
// (bucketBase is the scan of bucketSize), and every run's bucket (the paper's second compression step).
// Grid: one workgroup per tile of WORKGROUP * ROWS runs, any shape, tiles by take_tile.
#define ITEM_COUNT_BINDING 0
#define STATUS_BINDING 9
#define QUANTISER_BINDING 11
#include "include/proxy.glsl"
#include "include/item_count.glsl"
#include "include/tile_rows.glsl"

layout(set = 0, binding = 1, scalar) readonly buffer SortedHash { uint sorted_hash[]; };
layout(set = 0, binding = 2, scalar) readonly buffer SortedRun { uint sorted_run[]; };
// By run number.
layout(set = 0, binding = 3, scalar) readonly buffer RunBase { uint run_base[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer RunBucket { uint run_bucket[]; };
layout(set = 0, binding = 5, scalar) writeonly buffer BucketColor { uint bucket_color[]; };
layout(set = 0, binding = 6, scalar) writeonly buffer HashValue { uint hash_value[]; };
// Zero before the dispatch.
layout(set = 0, binding = 7, scalar) buffer BucketSize { uint bucket_size[]; };
layout(set = 0, binding = 8, scalar) buffer ProxyControl { uint proxy_control[]; };

layout(push_constant, scalar) uniform CompressBucketsPush {
    // COUNT_ON_DEVICE.
    uint count;
    // Voxels of the volume: where the last run ends.
    uint voxels;
};

// 1 where a bucket begins.
uint tile_item(uint index) {
    if (index >= item_count(count)) {
        return 0u;
    }
    return index == 0u || sorted_hash[index] != sorted_hash[index - 1u] ? 1u : 0u;
}

void main() {
    uint tile = take_tile(LOOKBACK_TICKET);
    uint end = item_count(count);
    uint tiles = (end + TILE - 1u) / TILE;
    if (tile >= tiles) {
        return;
    }
    uint is_head[ROWS];
    uint before[ROWS];
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        is_head[row] = tile_item(item_index(tile, row));
        before[row] = is_head[row];
    }
    TileScan scan = scan_tile(tile, exclusive_rows(before));
    if (scan.stop) {
        return;
    }
    uvec4 levels = uvec4(
        proxy_control[PROXY_LEVELS],
        proxy_control[PROXY_LEVELS + 1u],
        proxy_control[PROXY_LEVELS + 2u],
        proxy_control[PROXY_LEVELS + 3u]
    );
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        uint index = item_index(tile, row);
        uint bucket = 0xFFFFFFFFu;
        uint size = 0u;
        if (index < end) {
            bucket = scan.before + before[row] + is_head[row] - 1u;
            uint run = sorted_run[index];
            run_bucket[run] = bucket;
            size = (run + 1u < end ? run_base[run + 1u] : voxels) - run_base[run];
            if (is_head[row] != 0u) {
                hash_value[bucket] = sorted_hash[index];
                bucket_color[bucket] = color_of_hash(sorted_hash[index], levels);
            }
        }
        // Neighbours mostly share a bucket: one atomic for the subgroup then, else one each.
        uint first = subgroupMin(bucket);
        uint last = subgroupMax(bucket);
        if (first == last) {
            uint sum = subgroupAdd(size);
            if (subgroupElect() && bucket != 0xFFFFFFFFu) {
                atomicAdd(bucket_size[bucket], sum);
            }
        } else if (bucket != 0xFFFFFFFFu) {
            atomicAdd(bucket_size[bucket], size);
        }
    }
    if (tile == tiles - 1u && linear_index() == 0u) {
        proxy_control[PROXY_BUCKETS] = scan.inclusive;
    }
}
