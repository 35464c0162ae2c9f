// A ray, cut to the volume.
#ifndef RAY_GLSL
#define RAY_GLSL
#include "scene.glsl"

struct Ray {
    // Index space: position(t) = origin + direction * t, t in world units.
    vec3 origin;
    vec3 direction;
    // 1 / direction, finite.
    vec3 inverse;
    // Where the ray is inside the volume: begin < end, or empty.
    float begin;
    float end;
    // World length of a step.
    float dt;
};

// `origin` in index space, `direction` a unit vector in the world, `step_voxels` the length of a step in voxels.
Ray make_ray(vec3 origin, vec3 direction, float step_voxels) {
    Ray ray;
    ray.origin = origin;
    ray.direction = index_from_world_direction(direction);
    // Components that are zero divide to infinities of the right sign, unless the ray lies in a face plane: there
    // 0/0 must not decide, so such components are nudged.
    vec3 d = ray.direction;
    float longest = max(abs(d.x), max(abs(d.y), abs(d.z)));
    d = mix(d, vec3(longest * 1e-12), lessThan(abs(d), vec3(longest * 1e-12)));
    vec3 inverse = 1.0 / d;
    ray.inverse = inverse;
    vec3 a = -origin * inverse;
    vec3 b = (vec3(scene.dims) - origin) * inverse;
    vec3 near = min(a, b);
    vec3 far = max(a, b);
    ray.begin = max(0.0, max(near.x, max(near.y, near.z)));
    ray.end = min(far.x, min(far.y, far.z));
    ray.dt = step_voxels / length(ray.direction);
    return ray;
}

// The same from the eye, counted from where the volume begins: a far eye leaves few digits.
Ray make_eye_ray(vec3 direction, float step_voxels) {
    Ray ray = make_ray(index_from_world(scene.eye), direction, step_voxels);
    ray.origin += ray.direction * ray.begin;
    ray.end -= ray.begin;
    return ray;
}
#endif
