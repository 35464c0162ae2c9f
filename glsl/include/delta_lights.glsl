// Directional and point lights.
// The including kernel defines LIGHTS_BINDING.
#ifndef DELTA_LIGHTS_GLSL
#define DELTA_LIGHTS_GLSL
#include "scene.glsl"

// Some of the lights are point lights.
layout(constant_id = 8) const bool POINT_LIGHTS = true;

struct LightData {
    // Directional (is_point = 0): direction of travel; point: position. World.
    vec3 vector;
    uint is_point;
    // Irradiance or radiant intensity.
    vec3 power;
};

layout(set = 0, binding = LIGHTS_BINDING, scalar) readonly buffer Lights { LightData lights[]; };

// A light as one place sees it, without what lies between.
struct LightArrival {
    // Propagation direction, unit vector.
    vec3 travel;
    vec3 irradiance;
    // Distance to the light.
    float reach;
};

LightArrival light_at(LightData light, vec3 world) {
    LightArrival arrival = LightArrival(light.vector, light.power, 3.0e38);
    // Not a constant: reflection cannot evaluate operators on specialization constants.
    bool point_lights = POINT_LIGHTS;
    if (point_lights && light.is_point != 0u) {
        vec3 d = world - light.vector;
        arrival.reach = length(d);
        arrival.travel = arrival.reach > 0.0 ? d / arrival.reach : vec3(0.0, 0.0, 1.0);
        // A light inside a voxel lights it as if from half a voxel away: the voxel's own mean, not a singularity.
        float distance = max(arrival.reach, 0.5 * scene.mean_spacing);
        arrival.irradiance /= distance * distance;
    }
    return arrival;
}
#endif
