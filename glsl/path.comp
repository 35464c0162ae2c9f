#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_arithmetic : require
// Path tracer: unbiased, the reference for every other model (DESIGN section 5).
//
// Free flights by null-collision tracking over the macrocells' majorants, transmittance towards lights by ratio tracking
// over the same (Novák et al. 2018, "Monte Carlo methods for volumetric light transport simulation"). The extinction at a
// point is read from one of its eight voxels, drawn with the probability of its trilinear weight: its mean is the
// interpolated extinction exactly, and the material of a collision is the drawn voxel's own.
//
// Grid: x, y = pixels of a band of rows. Every invocation renders its own pixel's samples, one after another, and stops
// where its loop budget ends; the next dispatch goes on from the saved state, so that no path is ever cut short.
#define SCENE_COPIED
#define LIGHTS_BINDING 5
#define ENVIRONMENT_BINDING 6
#define ENVIRONMENT_SAMPLING
#include "include/scene.glsl"
#include "include/transfer.glsl"
#include "include/ray.glsl"
#include "include/rng.glsl"
#include "include/sphere.glsl"
#include "include/delta_lights.glsl"
#include "include/environment.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

// ENVIRONMENT has id 3 (environment.glsl).
layout(constant_id = 1) const bool ANISOTROPIC = false;
layout(constant_id = 4) const uint BACKGROUND = BACKGROUND_TRANSPARENT;
// There are delta lights.
layout(constant_id = 5) const bool LIT = false;
// Something in the medium emits.
layout(constant_id = 6) const bool EMITS = false;
// Paths end by Russian roulette, and where their scatterings reach the cap.
layout(constant_id = 7) const bool UNLIMITED = false;
// All of the medium has one albedo.
layout(constant_id = 9) const bool EVEN_ALBEDO = false;

layout(set = 0, binding = 2, r32f) readonly uniform image3D majorants;
layout(set = 0, binding = 3, r32f) readonly uniform image3D extinction;
layout(set = 0, binding = 4) uniform sampler3D scalar;

// A path under way, and what the invocation keeps between dispatches.
struct PathState {
    // Where the current ray starts, index space; its direction, world.
    vec3 position;
    vec3 direction;
    // Macrocell and distance along the ray [world].
    ivec3 cell;
    float t;
    // Direction of the flight that follows a shadow ray.
    vec3 next;
    // Product of albedos and weights so far.
    vec3 throughput;
    // What the current sample has gathered.
    vec3 radiance;
    // Light at the end of the shadow ray, and the transmittance so far.
    vec3 pending;
    float transmittance;
    // Distance to the light at the end of the shadow ray.
    float reach;
    // Density with which the flight's direction was drawn [1/sr].
    float density;
    // PATH_*
    uint stage;
    uint scatterings;
    // Samples of this round that are done, and random words drawn for the next one.
    uint done;
    uint draws;
};

layout(set = 0, binding = 8, scalar) buffer Paths { PathState paths[]; };
layout(set = 0, binding = 9, scalar) buffer Tally { uint tally[]; };
// Sums over the samples, as unevaluated pairs (high + low): rgb = radiance in the fields' scale, a = opacity; then rgb =
// squares of the radiance, a = weight of the paths that were cut at the cap.
layout(set = 0, binding = 10, rgba32f) uniform image2D sums;
layout(set = 0, binding = 11, rgba32f) uniform image2D sums_low;
layout(set = 0, binding = 12, rgba32f) uniform image2D squares;
layout(set = 0, binding = 13, rgba32f) uniform image2D squares_low;

layout(push_constant, scalar) uniform PathPush {
    uint row_begin;
    uint row_end;
    // First sample of this round, and how many.
    uint sample_begin;
    uint sample_count;
    // Scatterings after which a path ends.
    uint orders;
    uint light_count;
    // Loop iterations of this dispatch, and those of one event.
    uint budget;
    uint event_cost;
};

const uint TRACKING = 0u;
const uint COLLIDED = 1u;
const uint PASSED = 2u;

uint pixel_index;
// Parts of every draw's input: number of the round's first sample, and the seed's hash.
uint first_sample;
uint seed;
PathState path;
// Weight of the path, if it was cut at the cap.
float truncated = 0.0;

uvec4 draw() {
    return pcg4d(uvec4(pixel_index, first_sample + path.done, path.draws++, seed));
}

// Exponentially distributed with mean 1: −ln(1 − u), u a word over 2³². Small u by the series, so that thin media are
// met as often as they should; large u through the complement.
float exponential(uint word) {
    float u = (float(word) + 0.5) * 2.3283064e-10;
    float rest = (float(~word) + 0.5) * 2.3283064e-10;
    float series = u * (1.0 + u * (0.5 + u * (1.0 / 3.0 + u * (0.25 + u * (0.2 + u / 6.0)))));
    return u < 0.125 ? series : -log(rest);
}

// Sets out on a ray from the current position.
void set_out(uint stage, vec3 direction) {
    path.stage = stage;
    path.direction = direction;
    path.t = 0.0;
    path.cell = min(ivec3(path.position), ivec3(scene.dims) - 1) / int(CELL_SIZE);
}

// Draws a camera ray; TRACKING if it meets the volume, else PASSED.
uint begin_path() {
    path.draws = 0u;
    path.scatterings = 0u;
    path.throughput = vec3(1.0);
    path.radiance = vec3(0.0);
    vec2 place = unit_floats(draw()).xy;
    vec2 pixel = vec2(pixel_index % scene.size.x, pixel_index / scene.size.x);
    vec3 direction = eye_direction((pixel + place) / vec2(scene.size));
    Ray ray = make_ray(index_from_world(scene.eye), direction, 1.0);
    // Count from where the volume begins: a far eye leaves few digits.
    path.position = clamp(ray.origin + ray.direction * ray.begin, vec3(0.0), vec3(scene.dims));
    set_out(PATH_FLIGHT, direction);
    return ray.begin < ray.end ? TRACKING : PASSED;
}

// A ray from the current position, index space: direction per world unit, its inverse, and where it leaves the volume.
struct Leg {
    vec3 direction;
    vec3 inverse;
    float end;
};

// What make_ray() does for a start within the volume; precise, so that a leg is the same bytes whether a dispatch
// begins with it or comes to it.
Leg leg_towards(vec3 world) {
    precise vec3 d = scene.index_of_x * world.x + scene.index_of_y * world.y + scene.index_of_z * world.z;
    vec3 least = vec3(max(abs(d.x), max(abs(d.y), abs(d.z))) * 1e-12);
    precise vec3 inverse = 1.0 / mix(d, least, lessThan(abs(d), least));
    precise vec3 far = max(-path.position * inverse, (vec3(scene.dims) - path.position) * inverse);
    return Leg(d, inverse, min(far.x, min(far.y, far.z)));
}

// Adds (a, b), an unevaluated sum, to itself and `x` (Knuth's two-sum).
void add_exactly(inout vec4 high, inout vec4 low, vec4 x) {
    precise vec4 sum = high + x;
    precise vec4 shadow = sum - high;
    precise vec4 error = (high - (sum - shadow)) + (x - shadow);
    precise vec4 rest = low + error;
    precise vec4 total = sum + rest;
    precise vec4 left = rest - (total - sum);
    high = total;
    low = left;
}

// Light of a delta light, drawn with the chance of its share in what arrives without attenuation.
// Sets up the shadow ray; the light is already weighted with phase function and chance.
void aim_at_light(vec3 travelled, vec3 throughput, float u) {
    vec3 world = world_from_index(path.position);
    float sum = 0.0;
    float weight = 1.0;
    LightArrival best = LightArrival(vec3(0.0, 0.0, 1.0), vec3(0.0), 0.0);
    for (uint l = 0u; l < light_count; l++) {
        LightArrival light = light_at(lights[l], world);
        float phase = ANISOTROPIC ? phase_hg(scene.g, dot(light.travel, -travelled)) : 1.0 / (4.0 * PI);
        light.irradiance *= phase;
        float w = light.irradiance.r + light.irradiance.g + light.irradiance.b;
        sum += w;
        // The same random number serves all lights, stretched to what is left of it.
        float chance = sum > 0.0 ? w / sum : 0.0;
        if (u < chance) {
            best = light;
            weight = w;
            u /= chance;
        } else {
            u = chance < 1.0 ? (u - chance) / (1.0 - chance) : 0.0;
        }
    }
    path.pending = throughput * best.irradiance * (weight > 0.0 ? sum / weight : 0.0);
    path.reach = best.reach;
    path.next = path.direction;
    set_out(PATH_SHADOW, -best.travel);
}

// Next-event estimation towards an environment image: weighted against the phase function by the balance heuristic.
void aim_at_environment(vec3 travelled, vec3 throughput, vec3 u) {
    EnvironmentSample s = sample_environment(u.x < 0.5 ? 0u : 1u, 2u, u.yz);
    float phase = ANISOTROPIC ? phase_hg(scene.g, dot(-s.direction, -travelled)) : 1.0 / (4.0 * PI);
    path.pending = throughput * s.radiance * (phase / (0.5 / s.weight + phase));
    path.reach = 3.0e38;
    path.next = path.direction;
    set_out(PATH_SHADOW, s.direction);
}

// A collision at the current position, in `voxel`: emission, albedo, light, new direction. False ends the path.
bool scatter(ivec3 voxel) {
    vec3 albedo;
    if (EVEN_ALBEDO) {
        albedo = scene.even_albedo;
    } else {
        Material m = classify(texelFetch(scalar, voxel, 0).r);
        albedo = albedo_of(m);
        if (EMITS) {
            path.radiance += path.throughput * (1.0 - albedo) * m.emission;
        }
    }
    vec3 throughput = path.throughput * albedo;
    float most = max(throughput.r, max(throughput.g, throughput.b));
    if (path.scatterings >= orders || most == 0.0) {
        if (UNLIMITED && path.scatterings >= orders) {
            truncated = most;
        }
        return false;
    }
    path.scatterings++;
    vec4 u = unit_floats(draw());
    if (UNLIMITED && most < 0.25) {
        // Russian roulette for paths of little weight.
        float survival = max(most * 4.0, 0.05);
        if (u.w >= survival) {
            return false;
        }
        throughput /= survival;
    }
    path.throughput = throughput;
    vec3 travelled = path.direction;
    vec3 after;
    if (ANISOTROPIC) {
        after = sample_hg(scene.g, travelled, u.xy);
        path.density = phase_hg(scene.g, dot(travelled, after));
    } else {
        after = sphere_direction(u.x, u.y);
        path.density = 1.0 / (4.0 * PI);
    }
    set_out(PATH_FLIGHT, after);
    // Not constants: reflection cannot evaluate operators on specialization constants.
    bool lit = LIT;
    bool sky = ENVIRONMENT == ENVIRONMENT_IMAGE;
    if (lit || sky) {
        path.transmittance = 1.0;
        if (!sky) {
            aim_at_light(travelled, throughput, u.z);
        } else {
            // One of the two, by an even chance where there are both.
            float weight = lit ? 2.0 : 1.0;
            vec4 v = unit_floats(draw());
            if (lit && u.z >= 0.5) {
                aim_at_light(travelled, weight * throughput, v.x);
            } else {
                aim_at_environment(travelled, weight * throughput, v.yzw);
            }
        }
    }
    return true;
}

// Is there anything left to gather after the last scattering's shadow ray?
bool has_more() {
    bool emits = EMITS;
    bool sky = ENVIRONMENT != ENVIRONMENT_NONE;
    return path.scatterings < orders || emits || sky;
}

// A flight has left the volume, or has nothing to gather any more: the path ends.
void leave() {
    if (path.scatterings == 0u) {
        if (BACKGROUND == BACKGROUND_COLOR) {
            path.radiance += scene.background;
        } else if (BACKGROUND == BACKGROUND_ENVIRONMENT) {
            if (ENVIRONMENT != ENVIRONMENT_NONE) {
                path.radiance += environment_radiance(path.direction);
            }
        }
    } else if (ENVIRONMENT == ENVIRONMENT_CONSTANT) {
        path.radiance += path.throughput * scene.environment;
    } else if (ENVIRONMENT == ENVIRONMENT_IMAGE) {
        // The other half of the balance heuristic.
        float weight = path.density / (path.density + environment_density(path.direction));
        path.radiance += path.throughput * weight * environment_radiance(path.direction);
    }
}

void main() {
    scene = scene_in_memory;
    uvec2 pixel = uvec2(gl_GlobalInvocationID.x, row_begin + gl_GlobalInvocationID.y);
    if (pixel.x >= scene.size.x || pixel.y >= row_end) {
        return;
    }
    pixel_index = pixel.y * scene.size.x + pixel.x;
    first_sample = sample_begin;
    seed = pcg_hash(scene.seed_low ^ pcg_hash(scene.seed_high));
    uint slot = pixel_index - row_begin * scene.size.x;
    path = paths[slot];
    uint begun = path.done;
    if (begun >= sample_count) {
        return;
    }
    vec4 sum = imageLoad(sums, ivec2(pixel));
    vec4 sum_low = imageLoad(sums_low, ivec2(pixel));
    vec4 square = imageLoad(squares, ivec2(pixel));
    vec4 square_low = imageLoad(squares_low, ivec2(pixel));
    uvec3 cells = (scene.dims + CELL_SIZE - 1u) / CELL_SIZE;

    // Iterations of this loop and all loops within it. lavapipe counts a subgroup's iterations together, so its members
    // agree on how many there were.
    uint spent = 0u;
    while (path.done < sample_count) {
        spent = subgroupMax(spent) + event_cost;
        if (spent > budget) {
            break;
        }
        uint outcome = TRACKING;
        if (path.stage == PATH_START) {
            outcome = begin_path();
        }
        Leg leg = leg_towards(path.direction);
        // The flight that follows a shadow ray sets out from the same place, without coming back here.
        Leg onward = leg_towards(path.next);
        float limit = path.stage == PATH_SHADOW ? min(leg.end, path.reach) : leg.end;
        ivec3 hit = ivec3(0);
        uint crowd = subgroupBallotBitCount(subgroupBallot(true));
        while (outcome == TRACKING && spent < budget) {
            spent++;
            float majorant = imageLoad(majorants, path.cell).r;
            int reach = majorant > 0.0 ? 1 : int(-majorant);
            // The box of cells in which the majorant holds, and where the ray leaves it.
            ivec3 low = path.cell - (reach - 1);
            ivec3 high = path.cell + reach;
            bvec3 up = greaterThan(leg.inverse, vec3(0.0));
            vec3 face = vec3(mix(low, high, up)) * float(CELL_SIZE);
            vec3 exits = (face - path.position) * leg.inverse;
            float exit = max(path.t, min(exits.x, min(exits.y, exits.z)));
            float end = min(exit, limit);
            uvec4 words = draw();
            float flown = majorant > 0.0 ? path.t + exponential(words.x) / (majorant * scene.max_extinction) : 3.0e38;
            bool collides = flown < end;
            path.t = collides ? flown : end;
            vec3 p = path.position + leg.direction * path.t;
            vec3 jitter = unit_floats(uvec4(words.zw, words.z << 24u | (words.w & 255u) << 16u | (words.y & 255u) << 8u, 0u)).xyz;
            ivec3 voxel = clamp(ivec3(floor(p + jitter - 0.5)), ivec3(0), ivec3(scene.dims) - 1);
            float ratio = collides ? imageLoad(extinction, voxel).r / majorant : 0.0;
            bool shadow = path.stage == PATH_SHADOW;
            float u = unit_float(words.y);
            if (shadow) {
                path.transmittance *= 1.0 - ratio;
                // Russian roulette where little light is left.
                if (collides && path.transmittance < 0.1) {
                    path.transmittance = u < 0.5 ? 0.0 : 2.0 * path.transmittance;
                }
            } else if (u < ratio) {
                hit = voxel;
                outcome = COLLIDED;
            }
            if (!collides) {
                // Into the next cell: exactly across the face that the ray leaves by.
                bvec3 across = equal(exits, vec3(min(exits.x, min(exits.y, exits.z))));
                ivec3 inside = clamp(ivec3(floor(p / float(CELL_SIZE))), low, high - 1);
                path.cell = clamp(mix(inside, mix(low - 1, high, up), across), ivec3(0), ivec3(cells) - 1);
            }
            bool passes = !collides && exit >= limit;
            if (shadow && (passes || path.transmittance <= 0.0)) {
                path.radiance += path.pending * path.transmittance;
                set_out(PATH_FLIGHT, path.next);
                leg = onward;
                limit = leg.end;
                passes = !has_more();
            }
            outcome = passes ? PASSED : outcome;
            // Where few still fly, those that are done go on.
            if (2u * subgroupBallotBitCount(subgroupBallot(outcome == TRACKING)) < crowd) {
                break;
            }
        }
        bool alive = outcome != PASSED;
        if (outcome == COLLIDED) {
            path.position = clamp(path.position + leg.direction * path.t, vec3(0.0), vec3(scene.dims));
            alive = scatter(hit);
        } else if (outcome == PASSED) {
            leave();
        }
        if (!alive) {
            float opacity = BACKGROUND == BACKGROUND_TRANSPARENT && path.scatterings == 0u && outcome == PASSED ? 0.0 : 1.0;
            vec3 value = path.radiance * scene.radiance_scale;
            add_exactly(sum, sum_low, vec4(value, opacity));
            add_exactly(square, square_low, vec4(value * value, truncated));
            truncated = 0.0;
            path.stage = PATH_START;
            path.done++;
        }
    }

    paths[slot] = path;
    imageStore(sums, ivec2(pixel), sum);
    imageStore(sums_low, ivec2(pixel), sum_low);
    imageStore(squares, ivec2(pixel), square);
    imageStore(squares_low, ivec2(pixel), square_low);
    uint unfinished = subgroupAdd(path.done < sample_count ? 1u : 0u);
    uint samples = subgroupAdd(path.done - begun);
    if (subgroupElect()) {
        atomicAdd(tally[TALLY_UNFINISHED], unfinished);
        atomicAdd(tally[TALLY_SAMPLES], samples);
    }
}
