#version 460
#extension GL_GOOGLE_include_directive : require
// Occupancy: 0 for the macrocells in which a ray can meet extinction, else EMPTY (distance.comp and octants.comp refine it).
// Interpolation reaches one voxel beyond a cell.
// Grid: one invocation per cell, 4 x 4 x 4 workgroups.
#include "include/scene.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

// Component of the field that holds the extinction.
layout(constant_id = 0) const uint COMPONENT = 3u;
// Voxels along the edge of a macrocell.
layout(constant_id = 1) const uint EDGE = CELL_SIZE;
// What stands for no extinction.
layout(constant_id = 2) const uint EMPTY = MAX_EMPTINESS;

layout(set = 0, binding = 1) uniform sampler3D field;
layout(set = 0, binding = 2, r32ui) writeonly uniform uimage3D occupancy;

void main() {
    uvec3 cell = gl_GlobalInvocationID;
    if (any(greaterThanEqual(cell * EDGE, scene.dims))) {
        return;
    }
    ivec3 low = max(ivec3(cell * EDGE) - 1, ivec3(0));
    ivec3 high = min(ivec3(cell * EDGE + EDGE), ivec3(scene.dims) - 1);
    // At most (EDGE + 2)³ iterations.
    bool occupied = false;
    for (int z = low.z; z <= high.z && !occupied; z++) {
        for (int y = low.y; y <= high.y && !occupied; y++) {
            for (int x = low.x; x <= high.x; x++) {
                occupied = occupied || texelFetch(field, ivec3(x, y, z), 0)[COMPONENT] > 0.0;
            }
        }
    }
    imageStore(occupancy, ivec3(cell), uvec4(occupied ? 0u : EMPTY));
}
