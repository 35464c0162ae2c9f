// Directions on the sphere and the phase function. The same formulas as src/cpu/sphere.rs.
#ifndef SPHERE_GLSL
#define SPHERE_GLSL

const float PI = 3.14159265358979;

// The i-th of n directions, spread evenly (a rank-1 lattice with the golden ratio), shifted by two random numbers in
// [0, 1) around the torus: each direction for itself is uniform on the sphere, so means over them are unbiased.
vec3 lattice_direction(uint i, uint n, vec2 shift) {
    float u = fract((float(i) + 0.5) / float(n) + shift.x);
    float v = fract(float(i) * 0.61803398875 + shift.y);
    float z = 1.0 - 2.0 * u;
    float r = sqrt(max(0.0, 1.0 - z * z));
    float phi = 2.0 * PI * v;
    return vec3(r * cos(phi), r * sin(phi), z);
}

// Henyey-Greenstein [1/sr]; `cosine` between the propagation directions before and after.
float phase_hg(float g, float cosine) {
    // 1 + g² − 2 g c = (1 − |g|)² + 2 |g| (1 − s c), s the sign of g: no cancellation for |g| near 1.
    float a = abs(g);
    float d = (1.0 - a) * (1.0 - a) + 2.0 * a * max(0.0, 1.0 - sign(g) * cosine);
    return (1.0 - a) * (1.0 + a) / (4.0 * PI * d * sqrt(d));
}
#endif
