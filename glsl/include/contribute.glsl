// Adding scattered light to the volume: what a voxel sends on to the next order, and what it sends to the eye.
// Radiance arrives from many directions; stored are its first two moments (DESIGN section 2, "Direction dependence"):
//     source towards ω = σ_s (mean L + 3 g mean(L ω_i)·ω) = A + B·ω,  ω_i and ω propagation directions,
// per channel. For g = 0 B is zero and not stored. The eye's share uses the true phase function.
//
// The including kernel defines NEXT_BINDING: next_a, total there and at the next number, then next_x, next_y, next_z.
#ifndef CONTRIBUTE_GLSL
#define CONTRIBUTE_GLSL
#include "scene.glsl"
#include "transfer.glsl"
#include "sphere.glsl"

// g ≠ 0.
layout(constant_id = 1) const bool ANISOTROPIC = false;
// There is a next order, which needs the source.
layout(constant_id = 2) const bool HAS_NEXT = false;

layout(set = 0, binding = NEXT_BINDING, rgba16f) uniform image3D next_a;
layout(set = 0, binding = NEXT_BINDING + 1, rgba16f) uniform image3D total;
layout(set = 0, binding = NEXT_BINDING + 2, rgba16f) uniform image3D next_x;
layout(set = 0, binding = NEXT_BINDING + 3, rgba16f) uniform image3D next_y;
layout(set = 0, binding = NEXT_BINDING + 4, rgba16f) uniform image3D next_z;

// Light that arrives at a voxel, integrated over directions and divided by 4π.
struct Arrived {
    // mean L
    vec3 a;
    // mean L ω_i, a vector per channel: component of x, y, z
    vec3 x;
    vec3 y;
    vec3 z;
    // mean L 4π p(ω_i · ω_eye), of the light that the eye shall see through the cache
    vec3 eye;
};

Arrived nothing() {
    return Arrived(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0));
}

// Radiance `l` that propagates along `direction` (unit vector, world), weighted; for the next order only.
void arrive_unseen(inout Arrived sum, vec3 l, vec3 direction) {
    sum.a += l;
    if (ANISOTROPIC) {
        sum.x += l * direction.x;
        sum.y += l * direction.y;
        sum.z += l * direction.z;
    }
}

// The same for the next order and for the eye.
void arrive(inout Arrived sum, vec3 l, vec3 direction, vec3 to_eye) {
    arrive_unseen(sum, l, direction);
    sum.eye += ANISOTROPIC ? l * (4.0 * PI * phase_hg(scene.g, dot(direction, to_eye))) : l;
}

void add_to(ivec3 voxel, vec3 scattering, Arrived arrived, float extinction, bool first) {
    if (HAS_NEXT) {
        vec3 a = arrived.a * scattering;
        vec3 old = first ? vec3(0.0) : imageLoad(next_a, voxel).rgb;
        imageStore(next_a, voxel, vec4(min(old + a, MAX_HALF), extinction));
        if (ANISOTROPIC) {
            vec3 b = 3.0 * scene.g * scattering;
            vec3 old_x = first ? vec3(0.0) : imageLoad(next_x, voxel).rgb;
            vec3 old_y = first ? vec3(0.0) : imageLoad(next_y, voxel).rgb;
            vec3 old_z = first ? vec3(0.0) : imageLoad(next_z, voxel).rgb;
            imageStore(next_x, voxel, vec4(clamp(old_x + b * arrived.x, -MAX_HALF, MAX_HALF), 0.0));
            imageStore(next_y, voxel, vec4(clamp(old_y + b * arrived.y, -MAX_HALF, MAX_HALF), 0.0));
            imageStore(next_z, voxel, vec4(clamp(old_z + b * arrived.z, -MAX_HALF, MAX_HALF), 0.0));
        }
    }
    vec3 eye = imageLoad(total, voxel).rgb + scattering * arrived.eye;
    imageStore(total, voxel, vec4(min(eye, MAX_HALF), extinction));
}
#endif
