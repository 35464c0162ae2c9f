// From optical depths to opacities, and back.
#ifndef OPACITY_GLSL
#define OPACITY_GLSL

// 1 − e^−τ, by its series where the subtraction would cancel.
float opacity_of_depth(float tau) {
    return tau < 0.02 ? tau * (1.0 - tau * (0.5 - tau * (1.0 / 6.0 - tau * (1.0 / 24.0)))) : 1.0 - exp(-tau);
}

// −ln(1 − α), by its series where the subtraction would cancel.
float optical_depth_of_opacity(float opacity) {
    float a = min(opacity, 1.0 - 1.0 / 65536.0);
    return a < 0.02 ? a * (1.0 + a * (0.5 + a * (1.0 / 3.0 + a * (0.25 + a * 0.2)))) : -log(1.0 - a);
}
#endif
