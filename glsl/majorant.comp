#version 460
#extension GL_GOOGLE_include_directive : require
// Majorants: for every macrocell the largest relative extinction that interpolation can meet in it (it reaches one voxel
// beyond the cell), or, where that is zero, minus the distance to the nearest occupied cell in cells (distance.comp).
// Grid: one invocation per cell, 4 x 4 x 4 workgroups.
#include "include/scene.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

layout(set = 0, binding = 1) uniform sampler3D extinction;
layout(set = 0, binding = 2) uniform usampler3D emptiness;
layout(set = 0, binding = 3, r32f) writeonly uniform image3D majorants;

void main() {
    uvec3 cell = gl_GlobalInvocationID;
    uvec3 cells = (scene.dims + CELL_SIZE - 1u) / CELL_SIZE;
    if (any(greaterThanEqual(cell, cells))) {
        return;
    }
    ivec3 low = max(ivec3(cell * CELL_SIZE) - 1, ivec3(0));
    ivec3 high = min(ivec3(cell * CELL_SIZE + CELL_SIZE), ivec3(scene.dims) - 1);
    // At most (CELL_SIZE + 2)³ iterations.
    float most = 0.0;
    for (int z = low.z; z <= high.z; z++) {
        for (int y = low.y; y <= high.y; y++) {
            for (int x = low.x; x <= high.x; x++) {
                most = max(most, texelFetch(extinction, ivec3(x, y, z), 0).r);
            }
        }
    }
    float reach = max(1.0, float(texelFetch(emptiness, ivec3(cell), 0).r));
    imageStore(majorants, ivec3(cell), vec4(most > 0.0 ? most : -reach));
}
