#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
// Mark: which voxels, cells and nodes (cell.glsl) have to do with the medium, for compact.comp's lists; counts the voxels
// with extinction.
// Grid: one invocation per cell, which marks the block and the node of the same index too; 8 x 8 x 1 workgroups.
#include "include/scene.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 0, binding = 1) uniform sampler3D field;
// As octants.comp wrote it.
layout(set = 0, binding = 2) uniform usampler3D emptiness;
// Bits 1 << LISTED_*; one texel more along every axis than there are blocks.
layout(set = 0, binding = 3, r32ui) writeonly uniform uimage3D marks;
// Word 0: voxels with extinction.
layout(set = 0, binding = 4, scalar) buffer Tally { uint tally[]; };

layout(push_constant, scalar) uniform MarkPush {
    // Of the blocks whose cells and nodes are marked, in voxels.
    uint edge;
};

// Voxels whose extinction reaches between the planes `low` and `high`: the first, and the one after the last.
ivec3 first_voxel(vec3 low) {
    return max(ivec3(floor(low - 0.5)), ivec3(0));
}

ivec3 end_voxel(vec3 high) {
    return min(ivec3(ceil(high - 0.5)) + 1, ivec3(scene.dims));
}

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    ivec3 blocks = ivec3((scene.dims + edge - 1u) / edge);
    bool exists = all(lessThanEqual(at, blocks));
    bool is_block = all(lessThan(at, blocks));
    uint bits = 0u;
    uint active_voxels = 0u;
    // Where even the neighbours of a macrocell are empty, two cells into every octant, nothing about its voxels has extinction:
    // no node reaches farther than 2.5 voxels beyond its block, which is at most as large (MAX_LIGHT_EDGE).
    ivec3 macrocell = min(at * int(edge), ivec3(scene.dims) - 1) / int(SKIP_SIZE);
    uint word = texelFetch(emptiness, macrocell, 0).r;
    bool is_far = ((word >> 1u | word >> 2u | word >> 3u) & 0x11111111u) == 0x11111111u;
    ivec3 begin = at * int(edge);
    ivec3 end = begin + int(edge);
    // A cell ends half a block beyond where the block of its index begins, and so does the one after it, up to which a node
    // reaches. Blocks at the volume's end may be cut before their middle: then nothing is left for the cell after them.
    vec3 half_block = vec3(0.5 * float(edge));
    bool has_cell = all(lessThan(vec3(begin) - half_block, vec3(scene.dims)));
    if (exists && has_cell && !is_far) {
        ivec3 first = first_voxel(vec3(begin) - half_block);
        ivec3 cell_end = end_voxel(vec3(begin) + half_block);
        ivec3 node_end = is_block ? end_voxel(vec3(end) + half_block) : cell_end;
        for (int z = first.z; z < node_end.z; z++) {
            for (int y = first.y; y < node_end.y; y++) {
                for (int x = first.x; x < node_end.x; x++) {
                    ivec3 voxel = ivec3(x, y, z);
                    if (texelFetch(field, voxel, 0).a > 0.0) {
                        bits |= is_block ? 1u << LISTED_NODES : 0u;
                        bits |= all(lessThan(voxel, cell_end)) ? 1u << LISTED_CELLS : 0u;
                        bool is_own = all(greaterThanEqual(voxel, begin)) && all(lessThan(voxel, end));
                        active_voxels += is_own ? 1u : 0u;
                    }
                }
            }
        }
        bits |= active_voxels > 0u ? 1u << LISTED_VOXELS : 0u;
    }
    active_voxels = subgroupAdd(active_voxels);
    if (subgroupElect() && active_voxels > 0u) {
        atomicAdd(tally[0], active_voxels);
    }
    if (exists) {
        imageStore(marks, at, uvec4(bits));
    }
}
