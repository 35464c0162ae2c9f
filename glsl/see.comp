#version 460
#extension GL_GOOGLE_include_directive : require
// See: marks the cells that the eye sees, so that they can be given more directions than the others, and those that its rays
// reach at all (compact.comp).
// Grid: x, y = rays of a band of rows, `rays` x `rays` per pixel.
#define SCENE_COPIED
#include "include/march.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 0, binding = 1) uniform sampler3D field;
// As mark.comp wrote them; the bits of LISTED_SEEN and MARK_REACHED are added.
layout(set = 0, binding = 3, r32ui) uniform uimage3D marks;

layout(push_constant, scalar) uniform SeePush {
    // Rays per pixel along each axis of the picture.
    uint rays;
    // Rows of rays.
    uint row_begin;
    uint row_end;
    float step_voxels;
};

// A cell is seen by a ray of which it leaves at least this to see.
const float SEEN_TRANSMITTANCE = 1.0 / 16.0;

void main() {
    scene = scene_in_memory;
    uvec2 at = uvec2(gl_GlobalInvocationID.x, row_begin + gl_GlobalInvocationID.y);
    uvec2 count = scene.size * rays;
    if (at.x >= count.x || at.y >= row_end) {
        return;
    }
    Ray ray = make_eye_ray(eye_direction((vec2(at) + 0.5) / vec2(count)), step_voxels);
    float tau = 0.0;
    float through = 1.0;
    float t = 0.0;
    // As far as the camera's rays.
    while (t < ray.end && through > LEAST_TRANSMITTANCE) {
        float stride = min(ray.dt, ray.end - t);
        vec3 p = ray.origin + ray.direction * (t + 0.5 * stride);
        float sigma = textureLod(field, p / vec3(scene.dims), 0.0).a;
        if (sigma > 0.0) {
            // Cell c spans c − 0.5 to c + 0.5 blocks.
            vec3 cell = floor(p / float(scene.light_edge) + 0.5);
            ivec3 at = clamp(ivec3(cell), ivec3(0), ivec3(scene.light_dims));
            imageAtomicOr(marks, at / int(REACH_BLOCK) * int(REACH_BLOCK), 1u << MARK_REACHED);
            if (through > SEEN_TRANSMITTANCE) {
                imageAtomicOr(marks, at, 1u << LISTED_SEEN);
            }
        }
        tau += sigma * scene.max_extinction * stride;
        through = exp(-tau);
        t += steps_ahead(ray, p) * ray.dt;
    }
}
