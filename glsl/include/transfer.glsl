// The transfer function, evaluated exactly: piecewise linear between its points, constant beyond them. At two points of
// one value the later one holds.
#ifndef TRANSFER_GLSL
#define TRANSFER_GLSL
#include "opacity.glsl"
#include "scene.glsl"

struct TransferPointData {
    float value;
    // Opacity or extinction, before the density scale.
    float opacity;
    vec3 color;
    // Emitted radiance.
    vec3 emission;
};

layout(set = 0, binding = 1, scalar) readonly buffer TransferBlock { TransferPointData transfer[]; };

struct Material {
    // [1/unit]
    float extinction;
    vec3 color;
    vec3 emission;
};

Material classify(float value) {
    if (value == NO_VALUE) {
        return Material(0.0, vec3(0.0), vec3(0.0));
    }
    // First point whose value is greater than `value`: at most 32 halvings.
    uint low = 0u;
    uint high = scene.transfer_points;
    while (low < high) {
        uint middle = (low + high) / 2u;
        if (transfer[middle].value <= value) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    TransferPointData a = transfer[max(low, 1u) - 1u];
    TransferPointData b = transfer[min(low, scene.transfer_points - 1u)];
    // Large ones are made smaller, but not those that would get lost.
    float scale = max(abs(a.value), abs(b.value)) > 1.0 ? DIFFERENCE_SCALE : 1.0;
    precise float along = scale * value - scale * a.value;
    precise float width = scale * b.value - scale * a.value;
    float t = width > 0.0 ? clamp(along / width, 0.0, 1.0) : 0.0;
    float opacity = mix(a.opacity, b.opacity, t);
    Material m;
    m.extinction = scene.density_scale
        * (scene.unit_distance > 0.0 ? optical_depth_of_opacity(opacity) / scene.unit_distance : opacity);
    m.color = mix(a.color, b.color, t);
    m.emission = mix(a.emission, b.emission, t) * scene.emission_scale;
    return m;
}

vec3 albedo_of(Material m) {
    return clamp(m.color * scene.albedo_scale, 0.0, 1.0);
}
#endif
