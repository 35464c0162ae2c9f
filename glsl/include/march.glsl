// Rays through the volume in fixed steps, skipping cells without extinction.
// A step is a fixed length in index space, so that anisotropic voxels are sampled evenly.
//
// Where optical depths count, a step has two samples, at Gauss's points. Extinction falls to nothing with a kink, where the
// middle of a step finds too little of it, wherever the kink is: from inside a dense medium all light came out too bright, by an
// error that is of first order in the step. A rule that is exact for parabolas is right in the mean over the kink's places
// (docs/accuracy.md).
#ifndef MARCH_GLSL
#define MARCH_GLSL
#include "ray.glsl"

// Voxels along the edge of a macrocell; benches try others.
#ifndef SKIP_EDGE
#define SKIP_EDGE SKIP_SIZE
#endif

// Of every macrocell, how many cells a ray may cross before it can meet extinction, for each octant of directions
// (octants.comp); 0 = has extinction itself.
layout(set = 0, binding = 2) uniform usampler3D emptiness;

// Where the samples of a step are; each stands for half of it.
const float GAUSS[STEP_SAMPLES] = {0.21132487, 0.78867513};

// Whole steps that the ray may advance from `p`, its last sample's position: 1 where there may be extinction, else to the first
// sample beyond the empty cells ahead. Callers sample anyway and advance by this: an empty sample adds nothing, and on
// SIMD machines a branch would cost both of its sides (measured: 1.6 times).
float steps_ahead(Ray ray, vec3 p) {
    uvec3 cell = uvec3(clamp(p, vec3(0.0), vec3(scene.dims - 1u))) / SKIP_EDGE;
    bvec3 is_up = greaterThan(ray.inverse, vec3(0.0));
    uint octant = uint(is_up.x) | uint(is_up.y) << 1u | uint(is_up.z) << 2u;
    float reach = float(texelFetch(emptiness, ivec3(cell), 0).r >> OCTANT_BITS * octant & MAX_OCTANT);
    vec3 face = (vec3(cell) + mix(vec3(1.0 - reach), vec3(reach), is_up)) * float(SKIP_EDGE);
    vec3 t = (face - p) * ray.inverse;
    return reach > 0.0 ? max(1.0, ceil(min(t.x, min(t.y, t.z)) / ray.dt)) : 1.0;
}

// Steps of rays from points in the medium: the first are short, since what is near is seen largest and in most detail.
struct Stepper {
    // Where the step begins, and its length in steps of the ray.
    float t;
    float share;
};

Stepper first_step(Ray ray) {
    return Stepper(ray.begin, NEAR_STEP);
}

// `p`: where the step's last sample is.
void step_on(inout Stepper at, Ray ray, vec3 p) {
    // Only whole steps skip: so the steps are the same whatever is skipped.
    at.t += at.share < 1.0 ? at.share * ray.dt : steps_ahead(ray, p) * ray.dt;
    at.share = min(1.0, at.share + NEAR_STEP);
}

// (1 − e^−τ)/τ: the mean of the transmittance over a step of optical depth τ.
float mean_transmittance(float tau, float transmitted) {
    return tau > 1e-3 ? (1.0 - transmitted) / tau : 1.0 - 0.5 * tau;
}

// 1/τ − 1/(e^τ − 1): where in a step of optical depth τ, from 0 to 1, the light that leaves it at 0 comes from in the mean.
float mean_place(float tau, float transmitted) {
    return tau > 0.1 ? 1.0 / tau - transmitted / (1.0 - transmitted) : 0.5 - tau / 12.0;
}

const uint PARTS = 6u;

// Where in a step of `ray` its optical depth is `share` of the whole step's, from 0 to 1: by finer parts, for with one extinction
// in all of a step points near a surface come to lie too far out, where there is more light or nothing at all.
float place_of_depth(sampler3D field, Ray ray, float begin, float stride, float share) {
    float sigma[PARTS];
    float sum = 0.0;
    for (uint k = 0u; k < PARTS; k++) {
        vec3 p = ray.origin + ray.direction * (begin + (float(k) + 0.5) / float(PARTS) * stride);
        sigma[k] = textureLod(field, p / vec3(scene.dims), 0.0).a;
        sum += sigma[k];
    }
    float target = share * sum;
    float before = 0.0;
    float place = share;
    for (uint k = 0u; k < PARTS; k++) {
        if (sigma[k] > 0.0 && before < target) {
            place = (float(k) + min((target - before) / sigma[k], 1.0)) / float(PARTS);
        }
        before += sigma[k];
    }
    return place;
}

// Below this transmittance a ray ends: at most a thousandth of what lies behind is missed.
const float LEAST_TRANSMITTANCE = 1e-3;

// Transmittance along `ray` up to `limit` [world]; `field` holds relative extinction in its alpha. Two samples per step.
float transmittance(sampler3D field, Ray ray, float limit) {
    float end = min(ray.end, limit);
    float tau = 0.0;
    Stepper at = first_step(ray);
    // e^−7 is below LEAST_TRANSMITTANCE. The host keeps rays * steps within MAX_ITERATIONS.
    while (at.t < end && tau < 7.0) {
        float stride = min(at.share * ray.dt, end - at.t);
        vec3 p;
        for (uint k = 0u; k < STEP_SAMPLES; k++) {
            p = ray.origin + ray.direction * (at.t + GAUSS[k] * stride);
            tau += textureLod(field, p / vec3(scene.dims), 0.0).a * scene.max_extinction * 0.5 * stride;
        }
        step_on(at, ray, p);
    }
    return tau < 7.0 ? exp(-tau) : 0.0;
}
#endif
