// What bench_rays.comp sums up along a ray, and what it counts.
#ifndef INTEGRAL_GLSL
#define INTEGRAL_GLSL
#include "../march.glsl"

// Count steps and reads: in a pipeline of its own, so that the one that is timed does not.
layout(constant_id = 4) const bool COUNTED = false;

// Steps, trilinear samples, nearest reads. Reads of what is skipped by count too.
uvec3 counts = uvec3(0u);

void count(uint steps, uint samples, uint reads) {
    if (COUNTED) {
        counts += uvec3(steps, samples, reads);
    }
}

struct Integral {
    vec3 radiance;
    float through;
};

// Light of a stretch of optical depth `tau`, by the source function: radiance per 1 − transmittance.
void add_source_function(inout Integral sum, vec3 source, float tau) {
    float passed = exp(-tau);
    sum.radiance += source * (sum.through * tau * mean_transmittance(tau, passed));
    sum.through *= passed;
}

// Estimates end earlier than rays in the data, as those of gather_proxy.comp do.
const float LEAST_ESTIMATED = 1e-2;
#endif
