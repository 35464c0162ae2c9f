// Rays in the data, in steps of one sample each: structures differ in what they skip, not in what they find.
#ifndef EXACT_GLSL
#define EXACT_GLSL
#include "integral.glsl"

// Rgb = source function, a = extinction.
layout(set = 0, binding = 1) uniform sampler3D source;
// By structure: 0 for macrocells with extinction; distances; cubes.comp's words.
layout(set = 0, binding = 3) uniform usampler3D skips;

// Whole steps from `p` to the first sample beyond a box of macrocells.
float steps_to_leave(Ray ray, vec3 p, vec3 low, vec3 high) {
    vec3 face = mix(low, high, greaterThan(ray.inverse, vec3(0.0))) * float(SKIP_EDGE);
    vec3 t = (face - p) * ray.inverse;
    return max(1.0, ceil(min(t.x, min(t.y, t.z)) / ray.dt));
}

uvec3 macrocell_at(vec3 p) {
    return uvec3(clamp(p, vec3(0.0), vec3(scene.dims - 1u))) / SKIP_EDGE;
}

// As steps_ahead, by the structure.
float steps_skipped(Ray ray, vec3 p) {
    if (STRUCTURE == STRUCTURE_NONE) {
        return 1.0;
    }
    count(0u, 0u, 1u);
    if (STRUCTURE == STRUCTURE_OCTANTS) {
        return steps_ahead(ray, p);
    }
    if (STRUCTURE == STRUCTURE_FLAT) {
        return steps_ahead(ray, p);
    }
    uvec3 cell = macrocell_at(p);
    uint word = texelFetch(skips, ivec3(cell), 0).r;
    if (STRUCTURE == STRUCTURE_OCTREE) {
        uint level = word >> CUBES_VALUE_BITS;
        uvec3 low = cell >> level << level;
        bool is_empty = (word & (1u << CUBES_VALUE_BITS) - 1u) != 0u;
        return is_empty ? steps_to_leave(ray, p, vec3(low), vec3(low + (1u << level))) : 1.0;
    }
    float reach = float(word);
    return reach > 0.0 ? steps_to_leave(ray, p, vec3(cell) + 1.0 - reach, vec3(cell) + reach) : 1.0;
}

vec3 middle(Ray ray, float t, float stride) {
    return ray.origin + ray.direction * (t + 0.5 * stride);
}

void add_sample(inout Integral sum, vec3 p, float stride) {
    count(0u, 1u, 0u);
    vec4 f = textureLod(source, p / vec3(scene.dims), 0.0);
    add_source_function(sum, f.rgb, f.a * scene.max_extinction * stride);
}

bool goes_on(Ray ray, Stepper at, Integral sum) {
    return at.t < ray.end && sum.through > LEAST_TRANSMITTANCE;
}

void step_exact(inout Stepper at, Ray ray, inout Integral sum) {
    count(1u, 0u, 0u);
    float stride = min(at.share * ray.dt, ray.end - at.t);
    vec3 p = middle(ray, at.t, stride);
    add_sample(sum, p, stride);
    at.t += at.share < 1.0 ? at.share * ray.dt : steps_skipped(ray, p) * ray.dt;
    at.share = min(1.0, at.share + NEAR_STEP);
}

void trace_exact(Ray ray, inout Integral sum) {
    Stepper at = first_step(ray);
    while (goes_on(ray, at, sum)) {
        step_exact(at, ray, sum);
    }
}

// Macrocell by macrocell: each is looked at once, and crossed in one step or sampled to its end.
void trace_cells(Ray ray, inout Integral sum) {
    Stepper at = first_step(ray);
    for (; at.share < 1.0 && at.t < ray.end; at.share += NEAR_STEP) {
        count(1u, 0u, 0u);
        float stride = min(at.share * ray.dt, ray.end - at.t);
        add_sample(sum, middle(ray, at.t, stride), stride);
        at.t += at.share * ray.dt;
    }
    while (goes_on(ray, at, sum)) {
        count(1u, 0u, 1u);
        vec3 p = middle(ray, at.t, min(ray.dt, ray.end - at.t));
        uvec3 cell = macrocell_at(p);
        float here = steps_to_leave(ray, p, vec3(cell), vec3(cell + 1u));
        if (texelFetch(skips, ivec3(cell), 0).r > 0u) {
            at.t += here * ray.dt;
        } else {
            for (; here > 0.0 && goes_on(ray, at, sum); here -= 1.0) {
                float stride = min(ray.dt, ray.end - at.t);
                add_sample(sum, middle(ray, at.t, stride), stride);
                at.t += ray.dt;
            }
        }
    }
}
#endif
