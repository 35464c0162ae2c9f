// Fields of light and extinction as storage images: rgb and extinction, or grey and extinction in scenes without colour
// (passes::Stored). Through samplers either reads as (r, g, b, extinction).
#ifndef STORED_GLSL
#define STORED_GLSL

// What imageStore takes. Devices may cut what does not fit into half floats (lavapipe does), which makes all light darker: it
// is rounded before.
vec4 to_stored(vec3 light, float extinction) {
    vec4 texel = STORED_GREY == 1 ? vec4(light.r, extinction, 0.0, 0.0) : vec4(light, extinction);
    if (STORED_HALF == 1) {
        texel = vec4(unpackHalf2x16(packHalf2x16(texel.xy)), unpackHalf2x16(packHalf2x16(texel.zw)));
    }
    return texel;
}

// What imageLoad gave.
vec4 from_stored(vec4 texel) {
    return STORED_GREY == 1 ? texel.rrrg : texel;
}
#endif
