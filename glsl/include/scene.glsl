// The scene's numbers, one buffer for all kernels, and the way between voxel indices and positions. The kernels' world
// has its origin at the volume's centre.
// Index space: voxel i covers [i, i+1), its centre is at i + 0.5. Lengths along rays are in world units.
#ifndef SCENE_GLSL
#define SCENE_GLSL
#extension GL_EXT_scalar_block_layout : require
#include "constants.glsl"

struct SceneParams {
    // Index to world: columns of the matrix, and the world position of index (0, 0, 0).
    vec3 world_of_x;
    vec3 world_of_y;
    vec3 world_of_z;
    vec3 world_of_origin;
    // World to index: columns, and the index position of that origin.
    vec3 index_of_x;
    vec3 index_of_y;
    vec3 index_of_z;
    vec3 index_of_origin;
    // Voxels along x, y, z.
    uvec3 dims;
    // Light is computed and solved for in blocks of this many voxels along their edges, and so many of them (cell.glsl).
    uint light_edge;
    uvec3 light_dims;
    // Points of the transfer function.
    uint transfer_points;
    // Camera in the world; right and up are scaled to the half extents of the picture at distance 1.
    vec3 eye;
    vec3 forward;
    vec3 right;
    vec3 up;
    uvec2 size;
    // Unit distance of the opacity convention; 0: the transfer function gives extinction.
    float unit_distance;
    float density_scale;
    // Largest extinction [1/unit]. Fields hold extinction divided by it.
    float max_extinction;
    // Fields hold (source / max_extinction) * radiance_scale, which uses the range of half floats well.
    float radiance_scale;
    // Henyey-Greenstein mean cosine.
    float g;
    float emission_scale;
    vec3 albedo_scale;
    // Albedo of all of the medium, where it has but one.
    vec3 even_albedo;
    // Radiance of a constant environment, and the colour behind the medium.
    vec3 environment;
    vec3 background;
    // Rotation of a latitude-longitude environment about z in radians, and its sampling table's size.
    float environment_rotation;
    uvec2 environment_size;
    // Mean voxel spacing: the length in the extinction code of the proxy.
    float mean_spacing;
    uint seed_low;
    uint seed_high;
};

// Software devices read buffers lane by lane, at every use anew. A kernel with long loops defines SCENE_COPIED and
// copies the numbers once, `scene = scene_in_memory`; what it does not use costs nothing.
#ifdef SCENE_COPIED
layout(set = 0, binding = 0, scalar) readonly buffer SceneBlock { SceneParams scene_in_memory; };
SceneParams scene;
#else
layout(set = 0, binding = 0, scalar) readonly buffer SceneBlock { SceneParams scene; };
#endif

vec3 world_from_index(vec3 p) {
    return scene.world_of_x * p.x + scene.world_of_y * p.y + scene.world_of_z * p.z + scene.world_of_origin;
}

vec3 index_from_world_direction(vec3 d) {
    return scene.index_of_x * d.x + scene.index_of_y * d.y + scene.index_of_z * d.z;
}

vec3 index_from_world(vec3 p) {
    return index_from_world_direction(p) + scene.index_of_origin;
}

// Propagation direction of light that goes from a voxel to the eye: a unit vector even where they are the same point.
vec3 direction_to_eye(vec3 index_position) {
    vec3 d = scene.eye - world_from_index(index_position);
    float l = length(d);
    return l > 0.0 ? d / l : -scene.forward;
}

// Where the eye looks, a unit vector, at a place in the picture: (0, 0) its upper left, (1, 1) its lower right corner.
vec3 eye_direction(vec2 place) {
    vec2 film = place * 2.0 - 1.0;
    return normalize(scene.forward + film.x * scene.right - film.y * scene.up);
}

// Place of a linear index in a grid of `counts`, x fastest.
ivec3 from_linear(uint i, uvec3 counts) {
    uint row = i / counts.x;
    return ivec3(i - row * counts.x, row % counts.y, row / counts.y);
}

ivec3 voxel_from_linear(uint i) {
    return from_linear(i, scene.dims);
}
#endif
