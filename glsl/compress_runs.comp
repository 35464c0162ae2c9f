#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_shuffle : require
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

uint hash_at(uint voxel) {
    return hash_color(texelFetch(color, voxel_from_linear(voxel), 0).r, levels);
}

// 1 where a run begins.
uint tile_item(uint voxel) {
    if (voxel >= count) {
        return 0u;
    }
    return voxel == 0u || hash_at(voxel) != hash_at(voxel - 1u) ? 1u : 0u;
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
    // Every voxel is hashed once: the one before is the neighbouring lane's, or the last lane's of the row before.
    uint hashes[ROWS];
    uint is_head[ROWS];
    uint before[ROWS];
    uint first = item_index(tile, 0u) - gl_SubgroupInvocationID;
    uint last = hash_at(clamp(first, 1u, count) - 1u);
    [[unroll]] for (uint row = 0u; row < ROWS; row++) {
        uint voxel = item_index(tile, row);
        hashes[row] = hash_at(min(voxel, count - 1u));
        uint left = subgroupShuffle(hashes[row], max(gl_SubgroupInvocationID, 1u) - 1u);
        left = gl_SubgroupInvocationID == 0u ? last : left;
        last = subgroupBroadcast(hashes[row], gl_SubgroupSize - 1u);
        is_head[row] = voxel < count && (voxel == 0u || hashes[row] != left) ? 1u : 0u;
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
                run_hash[run] = hashes[row];
                run_base[run] = voxel;
                run_number[run] = run;
            }
        }
    }
    if (tile == tiles - 1u && linear_index() == 0u) {
        proxy_control[PROXY_FOUND] = scan.inclusive;
    }
}
