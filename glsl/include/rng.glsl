// Counter-based random numbers: a hash of (what, order, seed). The same bits as src/cpu/rng.rs.
#ifndef RNG_GLSL
#define RNG_GLSL

// PCG output function as a hash (O'Neill 2014; Jarzynski and Olano 2020, "Hash Functions for GPU Rendering").
uint pcg_hash(uint v) {
    uint state = v * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Key of an independent stream for item `item`; `stream` tells uses apart (order, purpose).
uint stream_key(uint item, uint stream, uint seed_low, uint seed_high) {
    return pcg_hash(item ^ pcg_hash(stream ^ pcg_hash(seed_low ^ pcg_hash(seed_high))));
}

// In [0, 1), from the word's upper 24 bits.
float unit_float(uint word) {
    return float(word >> 8u) * (1.0 / 16777216.0);
}

// The n-th number of a stream, in [0, 1).
float random_float(uint key, uint n) {
    return unit_float(pcg_hash(key + n * 2654435769u));
}

// Four words from four (Jarzynski and Olano 2020, pcg4d): all of the output depends on all of the input.
uvec4 pcg4d(uvec4 v) {
    v = v * 1664525u + 1013904223u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    v ^= v >> 16u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

vec4 unit_floats(uvec4 words) {
    return vec4(words >> 8u) * (1.0 / 16777216.0);
}
#endif
