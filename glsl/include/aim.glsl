// Directions of a gather. Light that nobody but the eye will see is scattered by the phase function about the direction to it:
// then half of the directions are drawn by that, and half are even, because light may come from where it is weak. Weights by
// the balance heuristic (Veach and Guibas 1995). All other light has even directions.
#ifndef AIM_GLSL
#define AIM_GLSL
#include "cell.glsl"
#include "sphere.glsl"

struct Aim {
    bool at_eye;
    // From the cell's middle.
    vec3 to_eye;
};

Aim make_aim(Cell cell, uint for_eye) {
    return Aim(for_eye != 0u, direction_to_eye(position_of(cell, vec3(0.5))));
}

// Where direction `number` of `count` comes from.
vec3 aimed_direction(Aim aim, uint number, uint count, vec2 shift) {
    if (aim.at_eye) {
        uint even = count / 2u;
        return number < even ? lattice_direction(number, even, shift)
                             : -sample_hg(scene.g, aim.to_eye, lattice_point(number - even, count - even, shift));
    }
    return lattice_direction(number, count, shift);
}

// Density of the phase function towards the eye over that of even directions.
float eye_density(Aim aim, vec3 towards) {
    return aim.at_eye ? 4.0 * PI * phase_hg(scene.g, dot(-towards, aim.to_eye)) : 1.0;
}

// Density of even directions over that of `towards`, one of `count`.
float aimed_weight(Aim aim, uint count, vec3 towards) {
    float even = float(count / 2u) / float(count);
    return aim.at_eye ? 1.0 / (even + (1.0 - even) * eye_density(aim, towards)) : 1.0;
}
#endif
