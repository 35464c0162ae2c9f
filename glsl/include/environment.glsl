// Light from infinitely far away. Directions point away from the volume, towards where the light comes from.
// Images and their sampling table as src/scene/environment.rs makes them: row 0 at +z, the centre column along +y,
// columns to its right towards +x, turned counter-clockwise about z by the rotation; constant over a texel.
//
// Half of the samples are spread evenly over the sphere, half are drawn from the image's radiance; each is weighted by
// the inverse of the mean density of both (the balance heuristic, Veach 1997), so bright suns and what they leave in
// the dark are both met without bias.
//
// The including kernel defines ENVIRONMENT_BINDING: the image; with ENVIRONMENT_SAMPLING also the table at the next.
#ifndef ENVIRONMENT_GLSL
#define ENVIRONMENT_GLSL
#include "scene.glsl"
#include "sphere.glsl"

layout(constant_id = 3) const uint ENVIRONMENT = ENVIRONMENT_NONE;

layout(set = 0, binding = ENVIRONMENT_BINDING) uniform sampler2D environment_image;

vec3 rotated_about_z(vec3 d, float angle) {
    float s = sin(angle);
    float c = cos(angle);
    return vec3(c * d.x - s * d.y, s * d.x + c * d.y, d.z);
}

// Unit direction to image coordinates in [0,1].
vec2 environment_uv(vec3 towards) {
    vec3 d = rotated_about_z(towards, -scene.environment_rotation);
    float azimuth = d.x == 0.0 && d.y == 0.0 ? 0.0 : atan(d.x, d.y);
    return clamp(vec2(azimuth / (2.0 * PI) + 0.5, acos(clamp(d.z, -1.0, 1.0)) / PI), 0.0, 1.0);
}

vec3 environment_radiance(vec3 towards) {
    if (ENVIRONMENT == ENVIRONMENT_CONSTANT) {
        return scene.environment;
    }
    vec2 size = vec2(textureSize(environment_image, 0));
    ivec2 texel = ivec2(min(environment_uv(towards) * size, size - 1.0));
    return texelFetch(environment_image, texel, 0).rgb;
}

#ifdef ENVIRONMENT_SAMPLING
// Cumulative sums: rows + 1 of the rows, then rows times columns + 1 within the rows.
layout(set = 0, binding = ENVIRONMENT_BINDING + 1, scalar) readonly buffer EnvironmentTable { float environment_table[]; };

struct EnvironmentSample {
    vec3 direction;
    vec3 radiance;
    // 1 / (directions * density): weighted radiances add up to the integral over the sphere.
    float weight;
};

// Interval of the cumulative sums `first`..`first + n` that holds `u`: its index, and in `u` the place within it.
uint pick_interval(uint first, uint n, inout float u) {
    uint low = 1u;
    uint high = n;
    while (low < high) {
        uint middle = (low + high) / 2u;
        if (environment_table[first + middle] <= u) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    float a = environment_table[first + low - 1u];
    float b = environment_table[first + low];
    u = b > a ? clamp((u - a) / (b - a), 0.0, 1.0) : 0.5;
    return low - 1u;
}

uint conditional_row(uint row) {
    return scene.environment_size.y + 1u + row * (scene.environment_size.x + 1u);
}

// Density of the table's draw [1/sr] in a cell.
float table_density(uvec2 cell) {
    uint row = conditional_row(cell.y);
    float p = (environment_table[cell.y + 1u] - environment_table[cell.y])
        * (environment_table[row + cell.x + 1u] - environment_table[row + cell.x]);
    float edge = PI / float(scene.environment_size.y);
    // cos a − cos b by the product formula: no cancellation near the poles.
    float band = 2.0 * sin(edge * (float(cell.y) + 0.5)) * sin(0.5 * edge);
    return p * float(scene.environment_size.x) / (2.0 * PI * band);
}

EnvironmentSample sample_environment(uint i, uint n, vec2 shift) {
    EnvironmentSample s;
    if (ENVIRONMENT == ENVIRONMENT_CONSTANT) {
        s.direction = lattice_direction(i, n, shift);
        s.radiance = scene.environment;
        s.weight = 4.0 * PI / float(n);
        return s;
    }
    // Even directions come first: n - n/2 of them, then n/2 drawn ones (n = 1: even only).
    uint drawn = n / 2u;
    uint even = n - drawn;
    uvec2 cell;
    if (i < even) {
        s.direction = lattice_direction(i, even, shift);
        vec2 uv = environment_uv(s.direction);
        cell = min(uvec2(uv * vec2(scene.environment_size)), scene.environment_size - 1u);
    } else {
        float u = fract(float(i - even) * 0.61803398875 + shift.x);
        float v = fract((float(i - even) + 0.5) / float(drawn) + shift.y);
        cell.y = pick_interval(0u, scene.environment_size.y, v);
        cell.x = pick_interval(conditional_row(cell.y), scene.environment_size.x, u);
        float edge = PI / float(scene.environment_size.y);
        float z = mix(cos(edge * float(cell.y)), cos(edge * float(cell.y + 1u)), v);
        float azimuth = 2.0 * PI * ((float(cell.x) + u) / float(scene.environment_size.x) - 0.5);
        float r = sqrt(max(0.0, 1.0 - z * z));
        s.direction = rotated_about_z(vec3(r * sin(azimuth), r * cos(azimuth), z), scene.environment_rotation);
    }
    s.radiance = environment_radiance(s.direction);
    s.weight = 1.0 / (float(even) / (4.0 * PI) + float(drawn) * table_density(cell));
    return s;
}

// Density [1/sr] of drawing one of the two samples of sample_environment(0 or 1, 2, ...) with equal chance, of an image.
float environment_density(vec3 towards) {
    uvec2 cell = min(uvec2(environment_uv(towards) * vec2(scene.environment_size)), scene.environment_size - 1u);
    return 0.5 / (4.0 * PI) + 0.5 * table_density(cell);
}
#endif
#endif
