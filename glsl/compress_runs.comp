#version 460
#extension GL_GOOGLE_include_directive : require
// Compress 1: runs of equal hash along the linear voxel order -> (hash, base) per run, and every voxel's run. Hashing,
// head flags, scan and writing in one pass: no flag array in memory (the paper's hash and first compression steps).
// Grid: one workgroup per tile of WORKGROUP * ROWS voxels, any shape, tiles by take_tile.
#define STATUS_BINDING 6
#define QUANTISER_BINDING 9
#include "include/scene.glsl"
#include "include/proxy.glsl"
#include "include/tile_rows.glsl"

layout(set = 0, binding = 1) uniform usampler3D color;
// Hash of every run.
layout(set = 0, binding = 2, scalar) writeonly buffer RunHash { uint run_hash[]; };
// First voxel of every run.
layout(set = 0, binding = 3, scalar) writeonly buffer RunBase { uint run_base[]; };
// Payload of the sort: the run's own number.
layout(set = 0, binding = 4, scalar) writeonly buffer RunNumber { uint run_number[]; };
layout(set = 0, binding = 5, scalar) buffer ProxyControl { uint proxy_control[]; };
layout(set = 0, binding = 8, r32ui) writeonly uniform uimage3D bucket_id;

layout(push_constant, scalar) uniform CompressRunsPush {
    // Voxels of the volume.
    uint count;
    // Runs that fit into the lists. What lies beyond is counted, not written.
    uint capacity;
};

// Numbers of levels of the channels.
uvec4 levels;

uint color_at(uint voxel) {
    return texelFetch(color, voxel_from_linear(voxel), 0).r;
}

// 1 where a run begins.
uint tile_item(uint voxel) {
    if (voxel >= count) {
        return 0u;
    }
    if (voxel == 0u) {
        return 1u;
    }
    uint here = color_at(voxel);
    uint before = color_at(voxel - 1u);
    return here != before && hash_color(here, levels) != hash_color(before, levels) ? 1u : 0u;
}

void main() {
    uint tile = take_tile(LOOKBACK_TICKET);
    uint tiles = (count + TILE - 1u) / TILE;
    if (tile >= tiles) {
        return;
    }
    levels = uvec4(
        proxy_control[PROXY_LEVELS],
        proxy_control[PROXY_LEVELS + 1u],
        proxy_control[PROXY_LEVELS + 2u],
        proxy_control[PROXY_LEVELS + 3u]
    );
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
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        uint voxel = item_index(tile, row);
        if (voxel < count) {
            uint run = scan.before + before[row] + is_head[row] - 1u;
            imageStore(bucket_id, voxel_from_linear(voxel), uvec4(run));
            if (is_head[row] != 0u && run < capacity) {
                run_hash[run] = hash_color(color_at(voxel), levels);
                run_base[run] = voxel;
                run_number[run] = run;
            }
        }
    }
    if (tile == tiles - 1u && linear_index() == 0u) {
        proxy_control[PROXY_FOUND] = scan.inclusive;
    }
}
