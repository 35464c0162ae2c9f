// Directions on the sphere and the phase function. The same formulas as src/cpu/sphere.rs.
#ifndef SPHERE_GLSL
#define SPHERE_GLSL

const float PI = 3.14159265358979;

// The direction of two numbers in [0, 1): uniform on the sphere where they are uniform.
vec3 sphere_direction(float u, float v) {
    float z = 1.0 - 2.0 * u;
    float r = sqrt(max(0.0, 1.0 - z * z));
    float phi = 2.0 * PI * v;
    return vec3(r * cos(phi), r * sin(phi), z);
}

// The i-th of n points, spread evenly over the unit square (a rank-1 lattice with the golden ratio), shifted by two random
// numbers in [0, 1) around the torus: each point for itself is uniform, so means over them are unbiased.
vec2 lattice_point(uint i, uint n, vec2 shift) {
    return fract(vec2((float(i) + 0.5) / float(n), float(i) * 0.61803398875) + shift);
}

// The i-th of n directions, spread evenly over the sphere.
vec3 lattice_direction(uint i, uint n, vec2 shift) {
    vec2 u = lattice_point(i, n, shift);
    return sphere_direction(u.x, u.y);
}

// Henyey-Greenstein [1/sr]; `cosine` between the propagation directions before and after.
float phase_hg(float g, float cosine) {
    // 1 + g² − 2 g c = (1 − |g|)² + 2 |g| (1 − s c), s the sign of g: no cancellation for |g| near 1.
    float a = abs(g);
    float d = (1.0 - a) * (1.0 - a) + 2.0 * a * max(0.0, 1.0 - sign(g) * cosine);
    return (1.0 - a) * (1.0 + a) / (4.0 * PI * d * sqrt(d));
}

// Unit vectors at right angles to `n` and to each other (Duff et al. 2017).
void orthonormal(vec3 n, out vec3 a, out vec3 b) {
    float s = n.z < 0.0 ? -1.0 : 1.0;
    float c = -1.0 / (s + n.z);
    float d = n.x * n.y * c;
    a = vec3(1.0 + s * n.x * n.x * c, s * d, -s * n.x);
    b = vec3(d, s + n.y * n.y * c, -n.y);
}

// A direction after scattering, distributed as phase_hg; `u` in [0, 1).
vec3 sample_hg(float g, vec3 before, vec2 u) {
    // 1 ∓ cosine about the peak without cancellation, for every g: the inverse distribution function, algebraically
    // rearranged. Backward scattering is forward scattering mirrored.
    float a = abs(g);
    float t = g < 0.0 ? 1.0 - u.x : u.x;
    float d = 1.0 - a + 2.0 * a * t;
    float less = 2.0 * (1.0 - t) * (1.0 - a) * (1.0 - a) * (1.0 + a * t) / (d * d);
    float more = 2.0 * t * (1.0 + a) * (1.0 + a) * (1.0 - a + a * t) / (d * d);
    float towards_peak = less < more ? 1.0 - less : more - 1.0;
    float cosine = g < 0.0 ? -towards_peak : towards_peak;
    float sine = sqrt(max(0.0, less * more));
    float phi = 2.0 * PI * u.y;
    vec3 x, y;
    orthonormal(before, x, y);
    return normalize(before * cosine + (x * cos(phi) + y * sin(phi)) * sine);
}
#endif
