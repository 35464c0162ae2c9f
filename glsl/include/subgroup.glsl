// Work mapping, sums and maxima over a workgroup, for any subgroup size >= SUBGROUP_MIN.
//
// Vulkan promises no relation between gl_LocalInvocationID and the subgroup lanes, so everything that uses subgroup
// operations maps its work by `linear_index()`. Subgroups are full: SPIR-V 1.6 promises it when the workgroup is a
// multiple of the subgroup size, and `subgroups_are_full()` checks it.
//
// Loops: every workgroup operation takes at most SUBGROUPS_MAX / SUBGROUP_MIN iterations (16 for 256 and 4).
#ifndef SUBGROUP_GLSL
#define SUBGROUP_GLSL
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#extension GL_KHR_shader_subgroup_ballot : require

layout(local_size_x = 256, local_size_x_id = 0) in;
layout(constant_id = 0) const uint WORKGROUP = 256u;
// Smallest subgroup size that the device may use: sizes the shared memory, nothing else.
layout(constant_id = 1) const uint SUBGROUP_MIN = 4u;
const uint SUBGROUPS_MAX = WORKGROUP / SUBGROUP_MIN;

shared uint subgroup_partials[SUBGROUPS_MAX];

// Index of the invocation in the workgroup: subgroup by subgroup, lane by lane.
uint linear_index() {
    return gl_SubgroupID * gl_SubgroupSize + gl_SubgroupInvocationID;
}

bool subgroups_are_full() {
    return gl_NumSubgroups * gl_SubgroupSize == WORKGROUP && gl_SubgroupSize >= SUBGROUP_MIN;
}

// Makes `partial` (the same in all lanes of a subgroup) of every subgroup visible to the workgroup.
void share_partials(uint partial) {
    barrier(); // an earlier call's readers may still read
    if (subgroupElect()) {
        subgroup_partials[gl_SubgroupID] = partial;
    }
    barrier();
}

// Sum of the `sum`s of the subgroups before this one; `total` = sum over all subgroups (wrapping).
// `sum` must be the same in all lanes of a subgroup. To be called by the whole workgroup.
uint exclusive_add_over_subgroups(uint sum, out uint total) {
    share_partials(sum);
    uint before = 0u;
    uint all = 0u;
    for (uint base = 0u; base < gl_NumSubgroups; base += gl_SubgroupSize) {
        uint i = base + gl_SubgroupInvocationID;
        uint partial = i < gl_NumSubgroups ? subgroup_partials[i] : 0u;
        all += partial;
        before += i < gl_SubgroupID ? partial : 0u;
    }
    total = subgroupAdd(all);
    return subgroupAdd(before);
}

// Sum of `value` over the invocations before this one in the order of `linear_index()`; `total` = sum over all.
uint workgroup_exclusive_add(uint value, out uint total) {
    uint in_subgroup = subgroupExclusiveAdd(value);
    return exclusive_add_over_subgroups(subgroupAdd(value), total) + in_subgroup;
}

// Sum of `value` over the workgroup (wrapping), in every invocation.
uint workgroup_add(uint value) {
    uint total;
    exclusive_add_over_subgroups(subgroupAdd(value), total);
    return total;
}

// Largest `value` of the workgroup, in every invocation.
uint workgroup_max(uint value) {
    share_partials(subgroupMax(value));
    uint largest = 0u;
    for (uint base = 0u; base < gl_NumSubgroups; base += gl_SubgroupSize) {
        uint i = base + gl_SubgroupInvocationID;
        largest = max(largest, i < gl_NumSubgroups ? subgroup_partials[i] : 0u);
    }
    return subgroupMax(largest);
}
#endif
