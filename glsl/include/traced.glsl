// The radiance that a direction brings, traced in the data.
// The including kernel defines LIGHTS_BINDING, and with COUNTED counts steps.
#ifndef TRACED_GLSL
#define TRACED_GLSL
#include "march.glsl"
#include "sphere.glsl"
#include "delta_lights.glsl"

// The source has a B (project_deposit.comp).
layout(constant_id = 1) const bool ANISOTROPIC = false;
// What is gathered: SOURCE_*.
layout(constant_id = 2) const uint SOURCE = SOURCE_PROJECTED;
// A constant environment is behind everything, and gathered with the light of the orders before.
layout(constant_id = 3) const bool SKY = false;

// Source of the order before: A and extinction; B by component for g ≠ 0 (project_deposit.comp).
layout(set = 0, binding = 6) uniform sampler3D source_a;
layout(set = 0, binding = 7) uniform sampler3D source_x;
layout(set = 0, binding = 8) uniform sampler3D source_y;
layout(set = 0, binding = 9) uniform sampler3D source_z;
#ifdef COUNTED
uint traced_steps = 0u;
#endif

// For SOURCE_LIGHT: where the light at `p` goes, and whether that differs from place to place.
vec3 light_travel(uint light, vec3 p) {
    return light_at(lights[light], world_from_index(p)).travel;
}

bool is_point_light(uint light) {
    bool point_lights = POINT_LIGHTS;
    return point_lights && lights[light].is_point != 0u;
}

// Radiance that arrives along the ray, against its direction `towards` (unit vector, world). `light`: the delta light, with
// SOURCE_LIGHT.
vec3 traced_radiance(Ray ray, vec3 towards, uint light) {
    float through = 1.0;
    vec3 radiance = vec3(0.0);
    Stepper at = first_step(ray);
    while (at.t < ray.end && through > LEAST_TRANSMITTANCE) {
        float stride = min(at.share * ray.dt, ray.end - at.t);
        vec3 p;
        for (uint k = 0u; k < STEP_SAMPLES; k++) {
            p = ray.origin + ray.direction * (at.t + GAUSS[k] * stride);
            vec3 uvw = p / vec3(scene.dims);
            vec4 f = textureLod(source_a, uvw, 0.0);
            vec3 source = f.rgb;
            if (ANISOTROPIC) {
                source -= textureLod(source_x, uvw, 0.0).rgb * towards.x + textureLod(source_y, uvw, 0.0).rgb * towards.y
                    + textureLod(source_z, uvw, 0.0).rgb * towards.z;
            }
            float part = scene.max_extinction * 0.5 * stride;
            float tau = f.a * part;
            float passed = exp(-tau);
            float scale = SOURCE == SOURCE_EMITTED ? part : tau;
            if (SOURCE == SOURCE_LIGHT) {
                if (is_point_light(light)) {
                    scale *= 4.0 * PI * phase_hg(scene.g, dot(light_travel(light, p), -towards));
                }
            }
            radiance += source * (through * scale * mean_transmittance(tau, passed));
            through *= passed;
#ifdef COUNTED
            traced_steps++;
#endif
        }
        step_on(at, ray, p);
    }
    if (SKY) {
        radiance += through * scene.radiance_scale * scene.environment;
    }
    return radiance;
}
#endif
