// The proxy's 8-bit colours: RGB = source function, A = extinction (DESIGN section 2, "hash"). The ranges come from the
// data. Square roots give dim light more of the 256 levels. The same formulas as src/cpu/proxy.rs.
#ifndef COLOR_CODE_GLSL
#define COLOR_CODE_GLSL
#include "scene.glsl"

// Opacity over one mean voxel spacing, relative to that of the largest extinction.
float most_opacity() {
    return 1.0 - exp(-scene.max_extinction * scene.mean_spacing);
}

// `field` texel to RGBA8, R in the lowest byte. `most` = largest source function (> 0 unless the volume is dark).
uint encode_color(vec4 field, float most) {
    if (field.a <= 0.0) {
        return 0u;
    }
    vec3 source = most > 0.0 ? clamp(field.rgb / most, 0.0, 1.0) : vec3(0.0);
    float opacity = (1.0 - exp(-field.a * scene.max_extinction * scene.mean_spacing)) / max(most_opacity(), 1e-30);
    uvec3 rgb = uvec3(sqrt(source) * 255.0 + 0.5);
    // An active voxel never looks empty.
    uint a = uint(clamp(opacity * 255.0 + 0.5, 1.0, 255.0));
    return rgb.r | rgb.g << 8u | rgb.b << 16u | a << 24u;
}

// Mean of the channels of the source function (times radiance_scale), and extinction relative to the largest, of a
// bucket. `value`: what its levels stand for (QUANTISER_VALUES). Colour 0 is empty space.
vec2 decode_color(uint color, vec4 value, float most) {
    if (color == 0u) {
        return vec2(0.0);
    }
    float source = (value.r + value.g + value.b) / (3.0 * float(CODE_SQUARE)) * most;
    float opacity = value.a / 255.0 * most_opacity();
    float extinction = -log(max(1.0 - opacity, 1.0 / 65536.0)) / (scene.max_extinction * scene.mean_spacing);
    return vec2(source, min(extinction, 1.0));
}
#endif
