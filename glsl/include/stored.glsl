// Fields of light and extinction as storage images: rgb and extinction, or grey and extinction in scenes without colour
// (passes::Stored). Through samplers either reads as (r, g, b, extinction).
#ifndef STORED_GLSL
#define STORED_GLSL

// What imageStore takes.
vec4 to_stored(vec3 light, float extinction) {
    return STORED_GREY == 1 ? vec4(light.r, extinction, 0.0, 0.0) : vec4(light, extinction);
}

// What imageLoad gave.
vec4 from_stored(vec4 texel) {
    return STORED_GREY == 1 ? texel.rrrg : texel;
}
#endif
