#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// Evaluates the phase function and draws from it, for `verify` and tests: the device's own arithmetic is what counts.
// Grid: one invocation per cosine and pair of random numbers.
#include "include/sphere.glsl"

layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Cosines { float cosines[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Randoms { vec2 randoms[]; };
layout(set = 0, binding = 2, scalar) writeonly buffer Densities { float densities[]; };
layout(set = 0, binding = 3, scalar) writeonly buffer Directions { vec3 directions[]; };

layout(push_constant, scalar) uniform PhaseProbePush {
    vec3 before;
    float g;
    uint count;
};

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < count) {
        densities[i] = phase_hg(g, cosines[i]);
        directions[i] = sample_hg(g, before, randoms[i]);
    }
}
