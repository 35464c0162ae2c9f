// Tickets, status words and diagnostics: what every single-pass kernel with decoupled look-back shares.
//
// A single-pass kernel cuts its input into tiles, one workgroup each, in the order of an atomic ticket: a tile that
// another one waits for has then always been started. Never order tiles by gl_WorkGroupID; drivers start workgroups
// in any order. A tile publishes what it knows in status words, of which other tiles read those before them:
//
//     bit 31 30 | 29 .. 0
//     state     | value          state 0 = nothing yet, 1 = READY (the tile's own sum), 2 = INCLUSIVE (sum up to and
//                                with the tile)
//
// State and value share one word, so relaxed atomics suffice. Words only grow (atomicMax), and all who publish the same
// state of a tile publish the same value: the owner and any number of helpers may do it, in any order.
//
// Where CARRY is not CARRY_LOOK_BACK none of this happens: no tile waits for another or reads what one of the same dispatch
// writes, so it does not matter which workgroups run when. Status words are plain sums then, without a state.
//
// Kernels keep to GLSL's own memory model: relaxed atomics with device scope need no more, and under
// `#pragma use_vulkan_memory_model` lavapipe 22.3.6 suspends the subgroup at every access to shared memory; a loop with
// such accesses that not all subgroups run then puts their later barriers out of step.
//
// The kernel defines STATUS_BINDING: `status` is bound there, `diagnostics` at STATUS_BINDING + 1.
// `status` is zero before the dispatch. `diagnostics` is never cleared here, so that its errors outlive the dispatch.
#ifndef TILE_STATUS_GLSL
#define TILE_STATUS_GLSL
#extension GL_KHR_memory_scope_semantics : require
#include "constants.glsl"
#include "subgroup.glsl"

// Polls of a missing status word before the workgroup computes the word itself. Forward progress of the tile waited
// for is not promised by Vulkan, and lavapipe leaves every loop after 65,535 iterations: no wait may be unbounded.
layout(constant_id = 2) const uint SPIN_LIMIT = 64u;
// For tests: when not 0, every WITHHOLD-th tile never publishes, as if its workgroup had been suspended for ever.
layout(constant_id = 3) const uint WITHHOLD = 0u;
// How sums get from tile to tile: CARRY_*.
layout(constant_id = 15) const uint CARRY = CARRY_LOOK_BACK;

layout(set = 0, binding = STATUS_BINDING, scalar) buffer Status { uint status[]; };
layout(set = 0, binding = STATUS_BINDING + 1, scalar) buffer Diagnostics { uint diagnostics[]; };

const uint STATE_NONE = 0u;
const uint STATE_READY = 1u;
const uint STATE_INCLUSIVE = 2u;
const uint STATE_SHIFT = 30u;
const uint VALUE_MASK = (1u << STATE_SHIFT) - 1u;

shared uint shared_ticket;

uint load_status(uint index) {
    return atomicLoad(status[index], gl_ScopeDevice, 0, 0);
}

void publish_status(uint index, uint state, uint value) {
    atomicMax(status[index], (state << STATE_SHIFT) | value, gl_ScopeDevice, 0, 0);
}

// Whether the tile's owner publishes (see CARRY, WITHHOLD).
bool may_publish(uint tile) {
    if (CARRY != CARRY_LOOK_BACK) {
        return false;
    }
    return WITHHOLD == 0u || tile % WITHHOLD != 0u;
}

void report_error(uint error) {
    atomicOr(diagnostics[DIAGNOSTICS_ERRORS], error, gl_ScopeDevice, 0, 0);
}

// Counts the polls that found a word missing, and the tiles computed in place of their owner.
void report_lookback(uint spins, uint fallbacks) {
    if (spins != 0u) {
        atomicAdd(diagnostics[DIAGNOSTICS_SPINS], spins, gl_ScopeDevice, 0, 0);
    }
    if (fallbacks != 0u) {
        atomicAdd(diagnostics[DIAGNOSTICS_FALLBACKS], fallbacks, gl_ScopeDevice, 0, 0);
    }
}

// The workgroup's tile, by the ticket counter at status[counter], or where no tile waits for another by its own number. A
// workgroup whose ticket is beyond the last tile has
// nothing to do. Returns NO_TILE, with an error reported, where the subgroups are not what this code relies on.
const uint NO_TILE = 0xFFFFFFFFu;
uint take_tile(uint counter) {
    if (!subgroups_are_full()) {
        report_error(ERROR_SUBGROUPS);
        return NO_TILE;
    }
    if (linear_index() == 0u) {
        if (CARRY == CARRY_LOOK_BACK) {
            shared_ticket = atomicAdd(status[counter], 1u, gl_ScopeDevice, 0, 0);
        } else {
            shared_ticket = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
        }
    }
    barrier();
    return shared_ticket;
}
#endif
