#version 460
#extension GL_GOOGLE_include_directive : require
// Classify: scalar -> extinction and order-0 source (DESIGN section 2, "classify"; pre-classification).
// Grid: one invocation per voxel, 8 x 8 x 1 workgroups over the volume.
// `field` gets a = extinction, rgb = nothing, the emitted source, or the colour as the emission-absorption model emits
// it, in the units of scene.glsl. `extinction_alone` gets the same extinction, for rays that read nothing else, and `scattering`
// the scattering coefficients.
#include "include/scene.glsl"
#include "include/transfer.glsl"
#include "include/stored.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(constant_id = 0) const uint EMITTED = EMITTED_NOTHING;
// `extinction_alone` is as large as the volume.
layout(constant_id = 1) const bool ALONE = false;
// `scattering` is as large as the volume.
layout(constant_id = 2) const bool SCATTERS = false;

layout(set = 0, binding = 2) uniform sampler3D scalar;
layout(set = 0, binding = 3, STORED_FORMAT) writeonly uniform image3D field;
layout(set = 0, binding = 4, r32f) writeonly uniform image3D extinction_alone;
// rgb = σ_s, a = extinction.
layout(set = 0, binding = 5, STORED_FORMAT) writeonly uniform image3D scattering;

void main() {
    uvec3 voxel = gl_GlobalInvocationID;
    if (any(greaterThanEqual(voxel, scene.dims))) {
        return;
    }
    Material m = classify(texelFetch(scalar, ivec3(voxel), 0).r);
    float extinction = m.extinction / scene.max_extinction;
    vec3 source = vec3(0.0);
    if (EMITTED == EMITTED_COLOR) {
        source = m.color;
    } else if (EMITTED == EMITTED_EMISSION) {
        source = (1.0 - albedo_of(m)) * m.emission;
    }
    vec4 texel = to_stored(min(source * extinction * scene.radiance_scale, MAX_HALF), extinction);
    imageStore(field, ivec3(voxel), texel);
    if (ALONE) {
        imageStore(extinction_alone, ivec3(voxel), from_stored(texel).aaaa);
    }
    if (SCATTERS) {
        imageStore(scattering, ivec3(voxel), to_stored(albedo_of(m) * extinction, extinction));
    }
}
