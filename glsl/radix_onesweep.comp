// One pass of the stable least-significant-digit radix sort of u32 keys with u32 payloads: OneSweep (Adinets and
// Merrill, arXiv 2206.01784). Each workgroup ranks its tile, finds by look-back where its keys of each digit go, and
// writes them: one read and one write per pair and pass.
//
// Grid: one workgroup per tile of WORKGROUP * KEYS pairs, any shape, tiles by ticket.
// Subgroups: any size >= SUBGROUP_MIN; the subgroup finds equal digits by ballots or, when it is narrow, by broadcasts.
// Buffers: keys_in, payloads_in -> keys_out, payloads_out (not the same memory); status (zero before the first pass):
//   RADIX_PASSES tickets, then per pass `rows` rows of RADIX_DIGITS words: row 0 from radix_scan.comp, row t + 1 of
//   tile t. Counts stay below 2^30, the width of a status word's value.
// Shared memory: SCRATCH_WORDS + RADIX_DIGITS words and a few.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require

#define ITEM_COUNT_BINDING 4
#define STATUS_BINDING 5
#include "include/item_count.glsl"
#include "include/radix.glsl"
#include "include/tile_status.glsl"

layout(constant_id = 4) const uint KEYS = 15u; // per invocation, at most 32 (FALLBACK_STEPS)
// Widest subgroup that finds equal digits by one broadcast per lane instead of one ballot per bit.
layout(constant_id = 5) const uint BROADCAST_UP_TO = 8u;
// At least WORKGROUP * KEYS, and COUNTER_WORDS for every subgroup that the workgroup may have.
layout(constant_id = 6) const uint SCRATCH_WORDS = 8192u;

layout(set = 0, binding = 0, scalar) readonly buffer KeysIn { uint keys_in[]; };
layout(set = 0, binding = 1, scalar) readonly buffer PayloadsIn { uint payloads_in[]; };
layout(set = 0, binding = 2, scalar) writeonly buffer KeysOut { uint keys_out[]; };
layout(set = 0, binding = 3, scalar) writeonly buffer PayloadsOut { uint payloads_out[]; };

layout(push_constant, scalar) uniform RadixOnesweepPush {
    uint count; // pairs, or COUNT_ON_DEVICE
    uint pass;
    uint bit_begin;
    uint bit_end;
    uint rows; // status rows per pass
};

const uint TILE = WORKGROUP * KEYS;
const uint DIGITS_EACH = (RADIX_DIGITS + WORKGROUP - 1u) / WORKGROUP;
// Two 16-bit counters per word: digit d is the low half of word d, digit d + COUNTER_WORDS the high half.
const uint COUNTER_WORDS = RADIX_DIGITS / 2u;
const uint NO_ROW = 0xFFFFFFFFu;

// First each subgroup's digit counters, then the tile's keys in sorted order, then its payloads.
shared uint scratch[SCRATCH_WORDS];
// Per digit: the tile's count, then its first place in the tile, then (fallback) a blocking tile's count, then what to
// add to a place in the tile to get the place in the output.
shared uint digits[RADIX_DIGITS];

uint digit_at(uint key) {
    return digit_of(key, pass, bit_begin, bit_end);
}

uint counter_word(uint digit) {
    return gl_SubgroupID * COUNTER_WORDS + digit % COUNTER_WORDS;
}

uint counter_shift(uint digit) {
    return digit / COUNTER_WORDS * 16u;
}

// Index of the invocation's key in `row` of a tile: the order in which equal digits keep their order.
uint key_index(uint tile, uint row) {
    return tile * TILE + (gl_SubgroupID * KEYS + row) * gl_SubgroupSize + gl_SubgroupInvocationID;
}

// The lanes of the subgroup that are `valid` and have the same digit: `rank` = how many of them come before this lane,
// `size` = how many there are, `leader` = the first.
void match_digit(bool valid, uint digit, out uint rank, out uint size, out uint leader) {
    if (gl_SubgroupSize <= BROADCAST_UP_TO) {
        uint own = valid ? digit : RADIX_DIGITS;
        rank = 0u;
        size = 0u;
        leader = gl_SubgroupSize;
        for (uint lane = 0u; lane < gl_SubgroupSize; lane++) {
            bool same = subgroupBroadcast(own, lane) == own;
            rank += same && lane < gl_SubgroupInvocationID ? 1u : 0u;
            size += same ? 1u : 0u;
            leader = same ? min(leader, lane) : leader;
        }
    } else {
        uvec4 same = subgroupBallot(valid);
        [[unroll]] for (uint bit = 0u; bit < RADIX_BITS; bit++) {
            uint own = digit >> bit & 1u;
            same &= subgroupBallot(own != 0u) ^ (own - 1u); // the ballot, or its complement if own == 0
        }
        rank = subgroupBallotExclusiveBitCount(same);
        size = subgroupBallotBitCount(same);
        leader = valid ? subgroupBallotFindLSB(same) : 0u;
    }
}

// Number of keys with this digit before each of the invocation's keys in the subgroup's part of the tile; leaves the
// subgroup's count of every digit in its counters. Stable: rows in order, lanes in order.
void rank_keys(uint tile, uint end, uint keys[KEYS], out uint ranks[KEYS]) {
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        bool valid = key_index(tile, row) < end;
        uint digit = digit_at(keys[row]);
        uint rank, size, leader;
        match_digit(valid, digit, rank, size, leader);
        uint before = 0u;
        if (valid && rank == 0u) {
            before = atomicAdd(scratch[counter_word(digit)], size << counter_shift(digit), gl_ScopeWorkgroup, 0, 0);
        }
        before = subgroupShuffle(before, leader);
        ranks[row] = (before >> counter_shift(digit) & 0xFFFFu) + rank;
        subgroupBarrier(); // the next row's leaders see this row's counts
    }
}

// Counts the digits of a tile in `digits`: what its owner would have published.
void count_digits(uint tile, uint end) {
    barrier(); // `digits` may still be read
    for (uint i = linear_index(); i < RADIX_DIGITS; i += WORKGROUP) {
        digits[i] = 0u;
    }
    barrier();
    for (uint row = 0u; row < KEYS; row++) {
        uint index = key_index(tile, row);
        if (index < end) {
            atomicAdd(digits[digit_at(keys_in[index])], 1u, gl_ScopeWorkgroup, 0, 0);
        }
    }
    barrier();
}

// Looks back for the invocation's digits [first, first + DIGITS_EACH): `before` = how many keys come before the tile's
// in the output: those of smaller digits, and those of the same digit in earlier tiles. False: out of budget, reported.
bool look_back(uint tile, uint end, uint base, uint first, out uint before[DIGITS_EACH]) {
    uint row[DIGITS_EACH]; // the status row to look at next, NO_ROW = done
    for (uint i = 0u; i < DIGITS_EACH; i++) {
        before[i] = 0u;
        row[i] = first + i < RADIX_DIGITS ? tile : NO_ROW;
    }
    uint steps = 0u;
    uint spins = 0u;
    uint fallbacks = 0u;
    bool failed = false;
    for (;;) {
        uint blocking = 0u; // highest row that is missing
        for (uint i = 0u; i < DIGITS_EACH; i++) {
            uint polls = 0u;
            while (row[i] != NO_ROW && polls <= SPIN_LIMIT && steps < LOOKBACK_BUDGET) {
                uint word = load_status(base + row[i] * RADIX_DIGITS + first + i);
                uint state = word >> STATE_SHIFT;
                if (state == STATE_NONE) {
                    polls++;
                    spins++;
                } else {
                    before[i] += word & VALUE_MASK;
                    row[i] = state == STATE_INCLUSIVE ? NO_ROW : row[i] - 1u;
                    polls = 0u;
                }
                steps++;
            }
            blocking = max(blocking, row[i] == NO_ROW ? 0u : row[i]);
        }
        bool stuck = false;
        for (uint i = 0u; i < DIGITS_EACH; i++) {
            // Row 0 is complete before this dispatch begins, and is never waited for.
            stuck = stuck || row[i] == 0u || (row[i] != NO_ROW && steps >= LOOKBACK_BUDGET);
        }
        blocking = workgroup_max(stuck ? NO_ROW : blocking);
        failed = blocking == NO_ROW;
        if (failed || blocking == 0u) {
            break;
        }
        count_digits(blocking - 1u, end);
        for (uint i = 0u; i < DIGITS_EACH; i++) {
            if (row[i] == blocking) {
                uint counted = digits[first + i];
                publish_status(base + blocking * RADIX_DIGITS + first + i, STATE_READY, counted);
                before[i] += counted;
                row[i] = blocking - 1u;
            }
        }
        steps += FALLBACK_STEPS;
        fallbacks++;
    }
    spins = workgroup_add(spins);
    if (linear_index() == 0u) {
        report_lookback(spins, fallbacks);
        if (failed) {
            report_error(ERROR_BUDGET);
        }
    }
    return !failed;
}

void main() {
    uint tile = take_tile(pass);
    uint end = item_count(count);
    if (tile >= (end + TILE - 1u) / TILE) {
        return;
    }
    uint base = RADIX_PASSES + pass * rows * RADIX_DIGITS;
    uint self = linear_index();
    uint first = self * DIGITS_EACH; // digits that this invocation looks after

    for (uint i = self; i < gl_NumSubgroups * COUNTER_WORDS; i += WORKGROUP) {
        scratch[i] = 0u;
    }
    uint keys[KEYS];
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint index = key_index(tile, row);
        keys[row] = index < end ? keys_in[index] : 0u;
    }
    barrier();

    uint places[KEYS];
    rank_keys(tile, end, keys, places);
    barrier();

    // Over the subgroups: counters become the number of keys in earlier subgroups, both halves of a word at once.
    for (uint i = self; i < COUNTER_WORDS; i += WORKGROUP) {
        uint sum = 0u;
        for (uint subgroup = 0u; subgroup < gl_NumSubgroups; subgroup++) {
            uint counter = scratch[subgroup * COUNTER_WORDS + i];
            scratch[subgroup * COUNTER_WORDS + i] = sum;
            sum += counter;
        }
        digits[i] = sum & 0xFFFFu;
        digits[i + COUNTER_WORDS] = sum >> 16u;
    }
    barrier();

    // Publish the tile's counts as early as possible, then find each digit's first place in the tile.
    uint counts[DIGITS_EACH];
    uint sum = 0u;
    for (uint i = 0u; i < DIGITS_EACH; i++) {
        counts[i] = first + i < RADIX_DIGITS ? digits[first + i] : 0u;
        sum += counts[i];
        if (first + i < RADIX_DIGITS && may_publish(tile)) {
            publish_status(base + (tile + 1u) * RADIX_DIGITS + first + i, STATE_READY, counts[i]);
        }
    }
    uint valid_keys;
    uint start = workgroup_exclusive_add(sum, valid_keys);
    uint starts[DIGITS_EACH];
    for (uint i = 0u; i < DIGITS_EACH; i++) {
        starts[i] = start;
        start += counts[i];
        if (first + i < RADIX_DIGITS) {
            digits[first + i] = starts[i];
        }
    }
    barrier();
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint digit = digit_at(keys[row]);
        uint in_subgroups = scratch[counter_word(digit)] >> counter_shift(digit) & 0xFFFFu;
        places[row] += in_subgroups + digits[digit];
    }
    barrier(); // the counters are dead from here
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        if (key_index(tile, row) < end) {
            scratch[places[row]] = keys[row];
        }
    }

    uint before[DIGITS_EACH];
    if (!look_back(tile, end, base, first, before)) {
        return; // nothing may be written to a wrong place
    }
    for (uint i = 0u; i < DIGITS_EACH; i++) {
        if (first + i < RADIX_DIGITS) {
            if (may_publish(tile)) {
                publish_status(base + (tile + 1u) * RADIX_DIGITS + first + i, STATE_INCLUSIVE, before[i] + counts[i]);
            }
            digits[first + i] = before[i] - starts[i];
        }
    }
    barrier();

    // In sorted order neighbouring invocations write neighbouring words, except where the digit changes.
    uint targets[KEYS];
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint place = row * WORKGROUP + self;
        if (place < valid_keys) {
            uint key = scratch[place];
            targets[row] = place + digits[digit_at(key)];
            keys_out[targets[row]] = key;
        }
    }
    barrier();
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint index = key_index(tile, row);
        if (index < end) {
            scratch[places[row]] = payloads_in[index];
        }
    }
    barrier();
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint place = row * WORKGROUP + self;
        if (place < valid_keys) {
            payloads_out[targets[row]] = scratch[place];
        }
    }
}
