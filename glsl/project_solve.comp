#version 460
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
// Solve: one step towards the values u at the nodes (cell.glsl) for which σ Σ_j v_j u_j is the σ_s L that was sampled, in the
// least-squares sense with weight 1/σ (v_j: the nodes' hat functions). The normal equations are
//     Σ_j M_ij u_j = b_i,  M_ij = ∫ σ v_i v_j dx,  b_i = ∫ v_i σ_s L dx  (project_deposit.comp),
// integrated over the cells' own points, so that a constant is met exactly whatever the points. The first step gives
// u = b_i / Σ_j M_ij; the others are Richardson's with Chebyshev's factors: D⁻¹M, D = Σ_j M_ij, has eigenvalues in (0, 1].
// Grid: one invocation per node of a chunk of the list.
#define LIST_BINDING 1
#define SCENE_COPIED
#include "include/list.glsl"
#include "include/cell.glsl"
#include "include/stored.glsl"

layout(local_size_x_id = 0) in;

// Cells are larger than voxels: extinction is not trilinear in them.
layout(constant_id = 1) const bool COARSE = false;
// The first step, which needs no values of a step before.
layout(constant_id = 2) const bool FIRST = false;

layout(set = 0, binding = 3) uniform sampler3D sums;
// rgb = u of the step before (nothing before the first step), a = extinction where nodes are voxels.
layout(set = 0, binding = 4) uniform sampler3D before;
// The same of this step. Where COARSE, a = 1 for nodes that have a value, 0 where all of their cells' points miss the medium.
layout(set = 0, binding = 5, STORED_FORMAT) writeonly uniform image3D after;
layout(set = 0, binding = 6, STORED_FORMAT) uniform image3D total;
// Solved before: light that enters every order.
layout(set = 0, binding = 7) uniform sampler3D fixed_light;
// a = extinction, where COARSE.
layout(set = 0, binding = 8) uniform sampler3D field;

layout(push_constant, scalar) uniform ProjectSolvePush {
    uint chunk_begin;
    uint chunk_items;
    // 1: the last step, whose result is added to `total`.
    uint adds;
    // 1: the last step, whose result gets `fixed_light` added.
    uint joins;
    // Factor of the step.
    float factor;
};

void main() {
    scene = scene_in_memory;
    uint item = gl_GlobalInvocationID.x;
    if (item >= items_in_chunk(chunk_begin, chunk_items)) {
        return;
    }
    ivec3 node = from_linear(list_items[chunk_begin + item], scene.light_dims);
    // Row i of M times u, and times 1.
    vec3 product = vec3(0.0);
    float row = 0.0;
    // The eight cells about the node share its 27 neighbours, which are read once: unrolled, all of them are registers.
    vec4 nodes[27];
    [[unroll]] for (uint k = 0u; k < 27u; k++) {
        ivec3 at = node + ivec3(k % 3u, k / 3u % 3u, k / 9u) - 1;
        nodes[k] = texelFetch(before, clamp(at, ivec3(0), ivec3(scene.light_dims) - 1), 0);
    }
    [[unroll]] for (uint neighbour = 0u; neighbour < 8u; neighbour++) {
        Cell cell = make_cell(node + ivec3(upper_bits(neighbour)));
        vec4 at[8];
        [[unroll]] for (uint corner = 0u; corner < 8u; corner++) {
            uvec3 of = uvec3(upper_bits(neighbour)) + uvec3(upper_bits(corner));
            at[corner] = nodes[of.x + 3u * of.y + 9u * of.z];
        }
        // From corners to points, one axis after another: the points form a grid.
        vec3 low = upper_weight(cell, point_place(cell, 0u));
        vec3 high = upper_weight(cell, point_place(cell, 7u));
        for (uint axis = 0u; axis < 3u; axis++) {
            uint bit = 1u << axis;
            for (uint pair = 0u; pair < 4u; pair++) {
                uint k = (pair & ~(bit - 1u)) << 1u | (pair & (bit - 1u));
                vec4 a = at[k];
                vec4 b = at[k | bit];
                at[k] = mix(a, b, low[axis]);
                at[k | bit] = mix(a, b, high[axis]);
            }
        }
        // The node is the corner opposite to the cell's place among its neighbours.
        bvec3 own = not(upper_bits(neighbour));
        vec3 own_low = mix(1.0 - low, low, own);
        vec3 own_high = mix(1.0 - high, high, own);
        float part = cell.size.x * cell.size.y * cell.size.z / float(CELL_POINTS);
        for (uint point = 0u; point < CELL_POINTS; point++) {
            vec3 w = mix(own_low, own_high, upper_bits(point));
            float extinction = at[point].a;
            if (COARSE) {
                vec3 position = position_of_point(cell, point);
                extinction = textureLod(field, position / vec3(scene.dims), 0.0).a;
            }
            float weight = part * w.x * w.y * w.z * extinction;
            row += weight;
            product += weight * at[point].rgb;
        }
    }
    vec4 old = texelFetch(before, node, 0);
    vec3 sum = texelFetch(sums, node, 0).rgb;
    vec3 u = vec3(0.0);
    if (row > 0.0) {
        u = FIRST ? sum / row : old.rgb + factor * (sum - product) / row;
    }
    if (adds != 0u) {
        vec4 seen = from_stored(imageLoad(total, node));
        imageStore(total, node, to_stored(clamp(seen.rgb + u, -MAX_HALF, MAX_HALF), seen.a));
    }
    if (joins != 0u) {
        u += texelFetch(fixed_light, node, 0).rgb;
    }
    float kept = old.a;
    if (COARSE) {
        kept = row > 0.0 ? 1.0 : 0.0;
    }
    imageStore(after, node, to_stored(clamp(u, -MAX_HALF, MAX_HALF), kept));
}
