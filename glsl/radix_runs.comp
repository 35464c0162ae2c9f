// One pass of the radix sort, for processors that stand in for a GPU: every invocation has a run of the tile's keys and counters of
// its own. So it finds a key's place without a word from other lanes, and a key goes straight to where it belongs: a processor's
// caches do what a GPU needs the tile's keys in order in shared memory for. A run is read twice, first to count, then to write.
//
// Grid: one workgroup per tile of WORKGROUP * KEYS pairs, any shape, tiles by take_tile. Workgroups are small, best one subgroup, and divide
// RADIX_DIGITS. No subgroup operations but for what look-back reports.
// Buffers, CARRY: see radix_pass.glsl and radix_onesweep.comp, which gives the same result.
// Shared memory: RADIX_DIGITS * (WORKGROUP + 1) words and a few.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#include "include/constants.glsl"
layout(constant_id = 4) const uint KEYS = 4u; // per invocation, a multiple of 4, at most 4 * RADIX_RUN_VECTORS
const uint COUNT_STEPS = FALLBACK_STEPS + RADIX_RUN_VECTORS;
// An invocation has up to 64 digits: unrolled they take a processor seconds to compile.
#define DIGITS_LOOP [[dont_unroll]]
#include "include/radix_pass.glsl"

// Runs begin where vectors do.
layout(set = 0, binding = 0, std430) readonly buffer KeyVectors { uvec4 key_vectors[]; };
layout(set = 0, binding = 1, std430) readonly buffer PayloadVectors { uvec4 payload_vectors[]; };

// By digit, then by invocation: how many keys of its run have it, then the place of the next one in the output.
shared uint counters[RADIX_DIGITS * WORKGROUP];

// A run: its first key, how many vectors of four it has, and how many keys beyond them.
struct Run {
    uint begin;
    uint vectors;
    uint rest;
};

// Runs follow one another: the order in which equal digits keep their order.
Run run_of(uint tile, uint end) {
    uint begin = tile * TILE + linear_index() * KEYS;
    uint keys = min(max(end, begin) - begin, KEYS);
    return Run(begin, keys / 4u, keys % 4u);
}

uint counter_of(uvec2 window, uint key) {
    return digit_in(window, key) * WORKGROUP + linear_index();
}

void count_key(uvec2 window, uint key, bool is_own) {
    if (is_own) {
        counters[counter_of(window, key)]++;
    } else {
        count_digit(key);
    }
}

// Counts the digits of a run: of the own tile in the invocation's counters, of another in `digits`.
void count_run(Run run, uvec2 window, bool is_own) {
    [[dont_unroll]] for (uint i = 0u; i < run.vectors; i++) {
        uvec4 keys = key_vectors[run.begin / 4u + i];
        [[unroll]] for (uint c = 0u; c < 4u; c++) {
            count_key(window, entering_key(keys[c]), is_own);
        }
    }
    [[dont_unroll]] for (uint i = 0u; i < run.rest; i++) {
        count_key(window, load_key(run.begin + 4u * run.vectors + i), is_own);
    }
}

void count_share(uint tile, uint end) {
    count_run(run_of(tile, end), uvec2(0u), false);
}

void write_pair(uvec2 window, uint key, uint payload) {
    uint counter = counter_of(window, key);
    uint place = counters[counter];
    counters[counter] = place + 1u;
    keys_out[place] = leaving_key(key);
    if (PAYLOADS != 0u) {
        payloads_out[place] = payload;
    }
}

void main() {
    uint self = linear_index();
    for (uint i = self; i < RADIX_DIGITS * WORKGROUP; i += WORKGROUP) {
        counters[i] = 0u;
    }
    if (self == 0u) {
        shared_blocking = 0u;
    }
    uint tile = take_tile(pass);
    uint end = item_count(count);
    if (tile >= (end + TILE - 1u) / TILE) {
        return;
    }
    if (status[RADIX_PASSES + pass] == RADIX_ALIKE) {
        copy_tile(tile, end);
        return;
    }
    uvec2 window = digit_window(pass, bit_begin, bit_end, digit_bits);
    Run run = run_of(tile, end);
    count_run(run, window, true);
    barrier();

    // The tile's counts are what others wait for: they come first.
    uint base = RADIX_HEAD + pass * rows * RADIX_DIGITS;
    uint first = self * DIGITS_EACH; // digits that this invocation looks after
    uint starts[DIGITS_EACH]; // 0: what look_back leaves is the place of the digit's first key in the output
    uint counts[DIGITS_EACH];
    DIGITS_LOOP for (uint i = 0u; i < DIGITS_EACH; i++) {
        starts[i] = 0u;
        counts[i] = 0u;
        [[dont_unroll]] for (uint k = 0u; k < WORKGROUP; k++) {
            counts[i] += counters[(first + i) * WORKGROUP + k];
        }
        uint own = base + (tile + 1u) * RADIX_DIGITS + first + i;
        if (may_publish(tile)) {
            publish_status(own, STATE_READY, counts[i]);
        } else if (CARRY == CARRY_COUNT) {
            status[own] = counts[i];
        }
    }
    if (CARRY == CARRY_COUNT) {
        return;
    }
    if (!look_back(tile, end, base, first, starts, counts)) {
        return; // nothing may be written to a wrong place
    }
    DIGITS_LOOP for (uint i = 0u; i < DIGITS_EACH; i++) {
        uint next = digits[first + i];
        [[dont_unroll]] for (uint k = 0u; k < WORKGROUP; k++) {
            uint counter = (first + i) * WORKGROUP + k;
            uint keys = counters[counter];
            counters[counter] = next;
            next += keys;
        }
    }
    barrier();

    [[dont_unroll]] for (uint i = 0u; i < run.vectors; i++) {
        uvec4 keys = key_vectors[run.begin / 4u + i];
        uvec4 payloads = PAYLOADS != 0u ? payload_vectors[run.begin / 4u + i] : uvec4(0u);
        [[unroll]] for (uint c = 0u; c < 4u; c++) {
            write_pair(window, entering_key(keys[c]), payloads[c]);
        }
    }
    [[dont_unroll]] for (uint i = 0u; i < run.rest; i++) {
        uint index = run.begin + 4u * run.vectors + i;
        write_pair(window, load_key(index), PAYLOADS != 0u ? payloads_in[index] : 0u);
    }
}
