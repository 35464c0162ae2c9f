// Exclusive scan of columns of words, in place and modulo 2^32: what comes before each tile, from the tiles' sums. The second
// of the three dispatches that carry sums without look-back (CARRY_COUNT, this, CARRY_GIVEN).
//
// Grid: one workgroup per column. Any subgroup size >= SUBGROUP_MIN.
// Buffers: status = rows of a word per column from `first` on.
//
// Loops: a step covers WORKGROUP * ROWS_EACH rows, so the 2^22 tiles that there may be (2^30 items in tiles of 256) take 1,024
// steps of at most 17 iterations each, with 256 invocations in subgroups of 4. A processor has
// 32 invocations and fewer tiles: lavapipe binds 2^25 items.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#define STATUS_BINDING 0
#include "include/tile_status.glsl"

layout(push_constant, scalar) uniform ColumnScanPush {
    uint first;
    uint rows;
};

const uint ROWS_EACH = 16u;

void main() {
    if (!subgroups_are_full()) {
        report_error(ERROR_SUBGROUPS);
        return;
    }
    uint columns = gl_NumWorkGroups.x;
    uint column = first + gl_WorkGroupID.x;
    uint before = 0u;
    for (uint begin = 0u; begin < rows; begin += WORKGROUP * ROWS_EACH) {
        uint row = begin + linear_index() * ROWS_EACH;
        uint values[ROWS_EACH];
        uint sum = 0u;
        [[unroll]] for (uint k = 0u; k < ROWS_EACH; k++) {
            values[k] = row + k < rows ? status[column + (row + k) * columns] : 0u;
            sum += values[k];
        }
        uint all;
        uint next = before + workgroup_exclusive_add(sum, all);
        [[unroll]] for (uint k = 0u; k < ROWS_EACH; k++) {
            if (row + k < rows) {
                status[column + (row + k) * columns] = next;
            }
            next += values[k];
        }
        before += all;
    }
}
