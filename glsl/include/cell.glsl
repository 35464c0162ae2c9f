// Cells: what scattered light is computed in. Nodes are the centres of blocks of light_edge³ voxels; where that is 1, the
// voxels' own. Cell c spans the eight nodes c − 1 + {0, 1}³, cut to the volume, so that (light_dims + 1) cells fill it and
// what is trilinear between nodes is so within one.
//
// Every cell has eight points, one per octant, at the same random place in each: a rule that integrates products of
// trilinear functions nearly as well as Gauss's two points per axis, and without its bias for steeper ones.
#ifndef CELL_GLSL
#define CELL_GLSL
#include "scene.glsl"
#include "rng.glsl"

struct Cell {
    ivec3 index;
    // Where it begins, and its edges: cut at the volume's faces. Index space.
    vec3 low;
    vec3 size;
    // Place of the points in their octants, 0 to 1.
    vec3 shift;
    // Weight of the upper nodes where it begins, and what is added to its end. Beyond the last node its value holds.
    vec3 weight_begin;
    vec3 weight_length;
};

ivec3 cell_from_linear(uint i) {
    return from_linear(i, scene.light_dims + 1u);
}

Cell make_cell(ivec3 index) {
    float edge = float(scene.light_edge);
    vec3 low = max((vec3(index) - 0.5) * edge, 0.0);
    // Blocks at the end may be cut before their middle: then nothing is left for the last cell.
    vec3 size = max(min((vec3(index) + 0.5) * edge, vec3(scene.dims)) - low, 0.0);
    uvec3 counts = scene.light_dims + 1u;
    uint linear = (uint(index.z) * counts.y + uint(index.y)) * counts.x + uint(index.x);
    uint key = stream_key(linear, CELL_STREAM, scene.seed_low, scene.seed_high);
    vec3 shift = vec3(random_float(key, 0u), random_float(key, 1u), random_float(key, 2u));
    bvec3 is_first = equal(index, ivec3(0));
    bvec3 is_end = equal(index * ivec3(index - ivec3(scene.light_dims)), ivec3(0));
    vec3 begin = mix(low / edge + 0.5 - vec3(index), vec3(is_first), is_end);
    return Cell(index, low, size, shift, begin, mix(size / edge, vec3(0.0), is_end));
}

// Bit k of `corner` or `point` says: the upper one along axis k.
bvec3 upper_bits(uint corner) {
    return bvec3(corner & 1u, corner >> 1u & 1u, corner >> 2u & 1u);
}

// Node at a corner; beyond the volume's faces there is none, and the weight is zero.
ivec3 corner_node(Cell cell, uint corner) {
    return cell.index - 1 + ivec3(upper_bits(corner));
}

bool is_node(ivec3 node) {
    return all(greaterThanEqual(node, ivec3(0))) && all(lessThan(node, ivec3(scene.light_dims)));
}

// Place of a point within the cell, 0 to 1.
vec3 point_place(Cell cell, uint point) {
    return 0.5 * (cell.shift + vec3(upper_bits(point)));
}

vec3 position_of(Cell cell, vec3 place) {
    return cell.low + cell.size * place;
}

vec3 position_of_point(Cell cell, uint point) {
    return position_of(cell, point_place(cell, point));
}

// Weight of the upper nodes along every axis.
vec3 upper_weight(Cell cell, vec3 place) {
    return cell.weight_begin + cell.weight_length * place;
}

float corner_weight(vec3 upper, uint corner) {
    vec3 w = mix(1.0 - upper, upper, upper_bits(corner));
    return w.x * w.y * w.z;
}

// The point that sample k of a cell is taken at: each point once in eight samples, four samples on no common edge. `flip`
// (0 to 7, random) makes every point equally likely whatever k. The quotient keeps every second of k, fourth, ... spread.
uint point_of_sample(uint k, uint flip) {
    return (0x12476530u >> 4u * ((k + k / CELL_POINTS) % CELL_POINTS) & 7u) ^ flip;
}
#endif
