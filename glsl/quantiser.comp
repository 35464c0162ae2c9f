#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// The quantiser of a channel: the level of every code, every level's lowest code, and what it stands for. Of a fixed mask a
// level are the codes that agree in the bits it keeps. Of an adaptive one levels are intervals: from the lowest code on each
// grows until its squared error would exceed a limit, which makes the fewest levels there can be under it. Of several limits
// the one with the fewest levels is taken whose errors together keep to the tolerance.
// Grid: one workgroup per channel (indirect). No subgroup operations.
#include "include/constants.glsl"

layout(local_size_x = ADAPTIVE_CAPS) in; // a limit each, and codes in turns
layout(constant_id = 0) const bool ADAPTIVE = false;

layout(set = 0, binding = 0, scalar) buffer ProxyControl { uint proxy_control[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer Quantiser { uint quantiser[]; };
// color_histogram.comp; read of an adaptive mask only.
layout(set = 0, binding = 2, scalar) readonly buffer ColorHistogram { uint color_histogram[]; };

const uint CHANNEL_A = 3u;

uint channel = gl_WorkGroupID.x;

// What a code stands for by itself: light as its square, opacity as it is.
float place_of(float code) {
    return channel == CHANNEL_A ? code : code * code;
}

void write(uint code, uint level, float value) {
    uint at = channel * CODES + code;
    quantiser[QUANTISER_LEVELS + at] = level;
    quantiser[QUANTISER_VALUES + at] = floatBitsToUint(value);
}

void write_masked() {
    uint kept = proxy_control[PROXY_MASK] >> 8u * channel & 0xFFu;
    for (uint code = gl_LocalInvocationIndex; code < CODES; code += ADAPTIVE_CAPS) {
        // The kept bits, packed together.
        uint level = 0u;
        uint place = 0u;
        for (uint bit = 0u; bit < 8u; bit++) {
            uint is_kept = kept >> bit & 1u;
            level |= (code >> bit & is_kept) << place;
            place += is_kept;
        }
        uint lowest = code & kept;
        // Middle of the codes of the level.
        write(code, level, place_of(min(float(lowest) + 0.5 * float(0xFFu & ~kept), 255.0)));
        if (code == lowest) {
            quantiser[QUANTISER_FLOORS + channel * CODES + level] = lowest;
        }
    }
    if (gl_LocalInvocationIndex == 0u) {
        proxy_control[PROXY_LEVELS + channel] = 1u << bitCount(kept);
    }
}

float histogram(uint row, uint code) {
    uint i = 2u * (row * CODES + code);
    precise float sum = float(color_histogram[i + 1u]) * 4294967296.0 + float(color_histogram[i]);
    return sum;
}

// Squared error of all voxels with a code, per squared step of what it stands for; 0: there are none.
shared float weights[CODES];
shared uint levels_by_cap[ADAPTIVE_CAPS];
shared float error_by_cap[ADAPTIVE_CAPS];

// Everything is one level: so coarse that any number of runs fits.
bool is_one(float tolerance) {
    return tolerance > 1.0;
}

// Grows levels under `cap`; returns their number and their error, and writes them if `writes`.
uint grow(float tolerance, float cap, bool writes, out float all_error) {
    uint level = 0u;
    uint first = 0u; // code of the level
    precise float weight = 0.0;
    precise float mean = 0.0;
    precise float error = 0.0;
    precise float total = 0.0;
    if (writes) {
        quantiser[QUANTISER_FLOORS + channel * CODES] = 0u;
    }
    for (uint code = 0u; code <= CODES; code++) {
        float added = code < CODES ? weights[code] : 1.0;
        // A code that does not occur belongs to the level below it.
        if (added > 0.0) {
            precise float sum = weight + added;
            precise float apart = place_of(float(code)) - mean;
            precise float grown = error + apart * apart * (weight * added / sum);
            // Without a limit everything is kept apart, empty voxels' code 0 as well. Empty space always is.
            bool is_apart = cap == 0.0 || grown > cap || channel == CHANNEL_A && first == 0u;
            if (code == CODES || code > 0u && is_apart && !is_one(tolerance)) {
                total += error;
                if (writes) {
                    for (uint c = first; c < code; c++) {
                        write(c, level, mean);
                    }
                }
                level++;
                first = code;
                weight = added;
                mean = place_of(float(code));
                error = 0.0;
                if (writes && code < CODES) {
                    quantiser[QUANTISER_FLOORS + channel * CODES + level] = code;
                }
            } else {
                mean += apart * (added / sum);
                weight = sum;
                error = grown;
            }
        }
    }
    all_error = total;
    return level;
}

void write_adaptive() {
    float tolerance = uintBitsToFloat(proxy_control[PROXY_MASK]);
    precise float voxels = 0.0;
    precise float light = 0.0;
    precise float energy = 0.0;
    for (uint code = 0u; code < CODES; code++) {
        voxels += histogram(HISTOGRAM_VOXELS, code);
        light += float(code) * histogram(HISTOGRAM_LIGHT, code);
        energy += histogram(HISTOGRAM_ENERGY, code);
    }
    precise float mean_energy = voxels > 0.0 ? energy / voxels : 0.0;
    precise float mean_light = voxels > 0.0 ? light / voxels : 0.0;
    for (uint code = gl_LocalInvocationIndex; code < CODES; code += ADAPTIVE_CAPS) {
        precise float weight = histogram(channel, code);
        if (channel == CHANNEL_A) {
            // An opacity that is wrong is so for what the voxel sends out and for what it hides, which is taken for as bright
            // as the volume's root mean square.
            weight = (weight + histogram(HISTOGRAM_VOXELS, code) * mean_energy) * float(CODE_SQUARE);
        }
        weights[code] = weight;
    }
    // Half of the tolerance is for the light, half for the opacity.
    precise float allowed = 0.5 * tolerance * mean_light;
    precise float most = allowed * allowed * voxels;
    barrier();

    precise float cap = most;
    for (uint i = 0u; i < gl_LocalInvocationIndex; i++) {
        cap *= ADAPTIVE_STEP;
    }
    float error;
    levels_by_cap[gl_LocalInvocationIndex] = grow(tolerance, cap, false, error);
    error_by_cap[gl_LocalInvocationIndex] = error;
    barrier();

    uint best = ADAPTIVE_CAPS - 1u;
    for (uint i = ADAPTIVE_CAPS - 1u; i-- > 0u;) {
        bool is_better = levels_by_cap[i] < levels_by_cap[best] ||
            levels_by_cap[i] == levels_by_cap[best] && error_by_cap[i] < error_by_cap[best];
        if (error_by_cap[i] <= most && is_better) {
            best = i;
        }
    }
    if (gl_LocalInvocationIndex == best) {
        proxy_control[PROXY_LEVELS + channel] = grow(tolerance, cap, true, error);
    }
}

void main() {
    if (ADAPTIVE) {
        write_adaptive();
    } else {
        write_masked();
    }
}
