// Scattering coefficients, interpolated between voxels.
// The including kernel defines SCATTERING_BINDING.
#ifndef SCATTERING_GLSL
#define SCATTERING_GLSL
#include "scene.glsl"

// All of the medium has one albedo.
layout(constant_id = 10) const bool EVEN_ALBEDO = false;

// a = extinction; rgb = σ_s per channel, as classify.comp wrote it, or anything where EVEN_ALBEDO. Relative to the largest extinction.
layout(set = 0, binding = SCATTERING_BINDING) uniform sampler3D scattering;

// σ_s at `p` (index space), and σ_t.
vec4 coefficients_at(vec3 p) {
    vec4 s = textureLod(scattering, p / vec3(scene.dims), 0.0);
    return EVEN_ALBEDO ? vec4(scene.even_albedo * s.a, s.a) : s;
}

vec3 scattering_at(vec3 p) {
    return coefficients_at(p).rgb;
}

// Albedo at `p`: σ_s and σ_t interpolated, then divided (DESIGN section 1).
vec3 albedo_at(vec3 p) {
    vec4 s = coefficients_at(p);
    return s.a > 0.0 ? s.rgb / s.a : vec3(0.0);
}
#endif
