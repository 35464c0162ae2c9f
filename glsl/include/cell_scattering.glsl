// Scattering coefficients at the corners of a cell, and between them.
#ifndef CELL_SCATTERING_GLSL
#define CELL_SCATTERING_GLSL
#include "cell.glsl"
#include "transfer.glsl"

// σ_s per channel of the voxels at the corners, relative to the largest extinction.
struct CornerScattering {
    vec3 at[8];
};

CornerScattering corner_scattering(sampler3D scalar, Cell cell) {
    CornerScattering s;
    for (uint corner = 0u; corner < 8u; corner++) {
        ivec3 voxel = clamp(corner_voxel(cell, corner), ivec3(0), ivec3(scene.dims) - 1);
        Material m = classify(texelFetch(scalar, voxel, 0).r);
        s.at[corner] = albedo_of(m) * (m.extinction / scene.max_extinction);
    }
    return s;
}

vec3 scattering_at(CornerScattering s, vec3 upper) {
    vec3 sum = vec3(0.0);
    for (uint corner = 0u; corner < 8u; corner++) {
        sum += corner_weight(upper, corner) * s.at[corner];
    }
    return sum;
}
#endif
