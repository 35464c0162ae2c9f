// Samples of the light that the points of a cell scatter: what the tracing kernels write and project_deposit.comp reads.
// The including kernel defines SAMPLES_BINDING and SAMPLES_ACCESS.
#ifndef SCATTER_SAMPLE_GLSL
#define SCATTER_SAMPLE_GLSL
#include "cell.glsl"
#include "sphere.glsl"

struct ScatterSample {
    // Scattering coefficient at the point times the radiance that arrives there, weighted such that a cell's samples add
    // up to its mean over points and directions; in the units of scene.glsl.
    vec3 light;
    // Propagation direction of the light.
    vec3 travel;
    uint point;
};

// [slot][item of the chunk]
layout(set = 0, binding = SAMPLES_BINDING, scalar) SAMPLES_ACCESS buffer Samples { ScatterSample samples[]; };
#endif
