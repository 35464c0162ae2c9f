// Scattering coefficients in a cell.
#ifndef CELL_SCATTERING_GLSL
#define CELL_SCATTERING_GLSL
#include "cell.glsl"
#include "transfer.glsl"

// Cells are larger than voxels.
layout(constant_id = 10) const bool COARSE = false;

// σ_s per channel, relative to the largest extinction: of the voxels at the cell's corners; where COARSE, at its points.
struct CellScattering {
    vec3 at[8];
};

vec3 voxel_scattering(sampler3D scalar, ivec3 voxel) {
    Material m = classify(texelFetch(scalar, clamp(voxel, ivec3(0), ivec3(scene.dims) - 1), 0).r);
    return albedo_of(m) * (m.extinction / scene.max_extinction);
}

CellScattering cell_scattering(sampler3D scalar, Cell cell) {
    CellScattering s;
    for (uint k = 0u; k < 8u; k++) {
        if (COARSE) {
            vec3 from_centre = position_of(cell, point_place(cell, k)) - 0.5;
            ivec3 low = ivec3(floor(from_centre));
            vec3 upper = from_centre - vec3(low);
            vec3 sum = vec3(0.0);
            for (uint corner = 0u; corner < 8u; corner++) {
                sum += corner_weight(upper, corner) * voxel_scattering(scalar, low + ivec3(upper_bits(corner)));
            }
            s.at[k] = sum;
        } else {
            s.at[k] = voxel_scattering(scalar, corner_node(cell, k));
        }
    }
    return s;
}

// At one of the cell's points.
vec3 scattering_at(CellScattering s, Cell cell, uint point) {
    if (COARSE) {
        return s.at[point];
    }
    vec3 upper = upper_weight(cell, point_place(cell, point));
    vec3 sum = vec3(0.0);
    for (uint corner = 0u; corner < 8u; corner++) {
        sum += corner_weight(upper, corner) * s.at[corner];
    }
    return sum;
}
#endif
