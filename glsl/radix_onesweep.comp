// One pass of the stable least-significant-digit radix sort of 32-bit keys with u32 payloads: OneSweep (Adinets and
// Merrill, arXiv 2206.01784). Each workgroup ranks its tile, finds by look-back where its keys of each digit go, and
// writes them: one read and one write per pair and pass. Without look-back (see CARRY) a dispatch before this one counts the
// tiles' digits, and another sums them: the classical three steps, with the same ranking and hence the same result.
//
// Grid: one workgroup per tile of WORKGROUP * KEYS pairs, any shape, tiles by take_tile.
// Subgroups: any size >= SUBGROUP_MIN; the subgroup finds equal digits by ballots or by masks.
// Buffers: see radix_pass.glsl. `digits`: a digit's first place in the tile and, 16 bits up, the tile's count, until the look-back.
// Shared memory: SCRATCH_WORDS + RADIX_DIGITS words and a few.
//
// Places beyond the count hold the largest image of a key. They come last in the last tile and sort last, so they get places like
// any other key, and only counts and stores leave them out.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#include "include/constants.glsl"
layout(constant_id = 4) const uint KEYS = 15u; // per invocation, at most 32
const uint COUNT_STEPS = FALLBACK_STEPS;
#include "include/radix_pass.glsl"

// At least WORKGROUP * ROUND_KEYS, and the counters (and masks) of every subgroup that the workgroup may have.
layout(constant_id = 6) const uint SCRATCH_WORDS = 8192u;

// Words of a ballot that are used: 1 where no subgroup has more than 32 lanes, else 4.
layout(constant_id = 8) const uint BALLOT_WORDS = 4u;
// Of an invocation's KEYS rows, how many find equal digits by a mask of lanes per digit in shared memory, instead of ballots;
// none where a digit is frequent (RADIX_SKEWED): lanes wait for each other there. Needs BALLOT_WORDS 1.
layout(constant_id = 9) const uint MASK_ROWS = 0u;
// The tile goes through shared memory in so many parts, one after the other: what is shared limits the workgroups under way.
layout(constant_id = 13) const uint ROUNDS = 1u;

// Counters of a subgroup, two of 16 bits to a word: the even digit's is the low half.
const uint COUNTER_WORDS = RADIX_DIGITS / 2u;
const uint WORDS_EACH = (COUNTER_WORDS + WORKGROUP - 1u) / WORKGROUP;
const uint PLACE_WORDS = (KEYS + 1u) / 2u; // half a word per row
const uint ROUND_KEYS = (KEYS + ROUNDS - 1u) / ROUNDS; // rows of a round in sorted order
const uint PADDING = 0xFFFFFFFFu;

// First each subgroup's digit counters (then: next places) and masks, then a round of the tile's keys in sorted order, then of its
// payloads.
shared uint scratch[SCRATCH_WORDS];

// The digit's `digit_window`. Read anew in every phase: else compilers keep the digits of all keys
// in registers from one phase to the next, and registers are what limits the workgroups under way.
shared uvec2 shared_window;
// What the pass's keys are like: RADIX_* (radix_scan.comp).
shared uint shared_likeness;

uint counter_word(uint digit) {
    return gl_SubgroupID * COUNTER_WORDS + digit / 2u;
}

uint counter_shift(uint digit) {
    return digit % 2u * 16u;
}

// Index of the invocation's key in `row` of a tile: the order in which equal digits keep their order.
uint key_index(uint tile, uint row) {
    return tile * TILE + (gl_SubgroupID * KEYS + row) * gl_SubgroupSize + gl_SubgroupInvocationID;
}

// The lanes of the subgroup that have the same digit: `rank` = how many of them come before this lane, `size` = how many there are.
void match_digit(uint digit, out uint rank, out uint size) {
    if (BALLOT_WORDS == 1u) {
        uint same = 0xFFFFFFFFu;
        [[unroll]] for (uint bit = 0u; bit < RADIX_BITS; bit++) {
            bool own = (digit >> bit & 1u) != 0u;
            uint set = subgroupBallot(own).x;
            same &= own ? set : ~set;
        }
        same &= gl_SubgroupSize < 32u ? (1u << gl_SubgroupSize) - 1u : 0xFFFFFFFFu;
        rank = bitCount(same & gl_SubgroupLtMask.x);
        size = bitCount(same);
    } else {
        uvec4 same = subgroupBallot(true);
        [[unroll]] for (uint bit = 0u; bit < RADIX_BITS; bit++) {
            uint own = digit >> bit & 1u;
            same &= subgroupBallot(own != 0u) ^ (own - 1u); // the ballot, or its complement if own == 0
        }
        rank = subgroupBallotExclusiveBitCount(same);
        size = subgroupBallotBitCount(same);
    }
}

// MASK_ROWS of KEYS rows, spread evenly: masks and ballots keep different parts of a multiprocessor busy.
bool is_mask_row(uint row) {
    return (row + 1u) * MASK_ROWS / KEYS != row * MASK_ROWS / KEYS;
}

// The next place for a key of this digit among those of the subgroup, lane by lane. Counts it.
uint take_place(uint digit, bool by_masks) {
    uint word = counter_word(digit);
    uint mask = gl_NumSubgroups * COUNTER_WORDS + gl_SubgroupID * RADIX_DIGITS + digit;
    uint rank, size, before;
    if (by_masks) {
        atomicOr(scratch[mask], gl_SubgroupEqMask.x, gl_ScopeWorkgroup, 0, 0);
        subgroupBarrier();
        uint same = scratch[mask];
        before = scratch[word];
        rank = bitCount(same & gl_SubgroupLtMask.x);
        size = bitCount(same);
    } else {
        match_digit(digit, rank, size);
        before = scratch[word];
    }
    subgroupBarrier(); // all have read
    if (rank == 0u) {
        if (by_masks) {
            scratch[mask] = 0u;
        }
        atomicAdd(scratch[word], size << counter_shift(digit), gl_ScopeWorkgroup, 0, 0);
    }
    subgroupBarrier(); // the next row sees this row's counts
    return (before >> counter_shift(digit) & 0xFFFFu) + rank;
}

// Two rows share a word: the half of row `row`.
uint half_of(uint word, uint row) {
    return row % 2u == 0u ? word & 0xFFFFu : word >> 16u;
}

// Places of all keys among their subgroup's keys of the same digit, row by row: stable.
void take_places(uint keys[KEYS], bool by_masks, out uint places[PLACE_WORDS]) {
    uvec2 window = shared_window;
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint place = take_place(digit_in(window, keys[row]), by_masks && is_mask_row(row));
        places[row / 2u] = row % 2u == 0u ? place : places[row / 2u] | place << 16u;
    }
}

// Puts those of the tile's words whose places are in `round` there.
void share(uint words[KEYS], uint places[PLACE_WORDS], uint round) {
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint place = half_of(places[row / 2u], row) - round * ROUND_KEYS * WORKGROUP; // earlier ones wrap around
        if (ROUNDS == 1u || place < ROUND_KEYS * WORKGROUP) {
            scratch[place] = words[row];
        }
    }
}

void count_share(uint tile, uint end) {
    [[dont_unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint index = key_index(tile, row);
        if (index < end) {
            count_digit(load_key(index));
        }
    }
}

void main() {
    uint self = linear_index();
    // While the ticket is on its way.
    uint cleared = min(gl_NumSubgroups * (COUNTER_WORDS + min(MASK_ROWS, 1u) * RADIX_DIGITS), SCRATCH_WORDS);
    for (uint i = self; i < cleared; i += WORKGROUP) {
        scratch[i] = 0u;
    }
    if (self == 0u) {
        shared_window = digit_window(pass, bit_begin, bit_end, digit_bits);
        shared_likeness = status[RADIX_PASSES + pass];
        shared_blocking = 0u;
    }
    uint tile = take_tile(pass);
    uint end = item_count(count);
    if (tile >= (end + TILE - 1u) / TILE) {
        return;
    }
    if (shared_likeness == RADIX_ALIKE) {
        copy_tile(tile, end);
        return;
    }
    uint base = RADIX_HEAD + pass * rows * RADIX_DIGITS;
    uint first = self * DIGITS_EACH; // digits that this invocation looks after
    uint valid_keys = min(end - tile * TILE, TILE);

    uint keys[KEYS];
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint index = key_index(tile, row);
        keys[row] = index < end ? load_key(index) : PADDING;
    }

    uint places[PLACE_WORDS];
    if (CARRY == CARRY_COUNT) {
        [[unroll]] for (uint row = 0u; row < KEYS; row++) {
            uint digit = digit_at(keys[row]);
            atomicAdd(scratch[counter_word(digit)], 1u << counter_shift(digit), gl_ScopeWorkgroup, 0, 0);
        }
    } else if (MASK_ROWS != 0u && shared_likeness != RADIX_SKEWED) {
        take_places(keys, true, places);
    } else {
        take_places(keys, false, places);
    }
    barrier();

    // The tile's counts are what others wait for: they come first. Both halves of a word at once.
    uint sums[WORDS_EACH];
    uint sum = 0u;
    [[unroll]] for (uint i = 0u; i < WORDS_EACH; i++) {
        uint word = self * WORDS_EACH + i;
        sums[i] = 0u;
        if (word < COUNTER_WORDS) {
            [[unroll]] for (uint subgroup = 0u; subgroup < SUBGROUPS_MAX; subgroup++) {
                sums[i] += subgroup < gl_NumSubgroups ? scratch[subgroup * COUNTER_WORDS + word] : 0u;
            }
            uint padded = digit_at(PADDING);
            sums[i] -= word == padded / 2u ? TILE - valid_keys << counter_shift(padded) : 0u;
            uint row = base + (tile + 1u) * RADIX_DIGITS + 2u * word;
            uvec2 both = uvec2(sums[i] & 0xFFFFu, sums[i] >> 16u);
            if (may_publish(tile)) {
                publish_status(row, STATE_READY, both.x);
                publish_status(row + 1u, STATE_READY, both.y);
            } else if (CARRY == CARRY_COUNT) {
                status[row] = both.x;
                status[row + 1u] = both.y;
            }
            sum += both.x + both.y;
        }
    }
    if (CARRY == CARRY_COUNT) {
        return;
    }
    uint all;
    uint start = workgroup_exclusive_add(sum, all);
    [[unroll]] for (uint i = 0u; i < WORDS_EACH; i++) {
        uint word = self * WORDS_EACH + i;
        if (word < COUNTER_WORDS) {
            uvec2 both = uvec2(sums[i] & 0xFFFFu, sums[i] >> 16u);
            digits[2u * word] = start | both.x << 16u;
            digits[2u * word + 1u] = start + both.x | both.y << 16u;
            // Counters become the place of each subgroup's first key of the digit.
            uint next = start | start + both.x << 16u;
            [[unroll]] for (uint subgroup = 0u; subgroup < SUBGROUPS_MAX; subgroup++) {
                if (subgroup < gl_NumSubgroups) {
                    uint counter = scratch[subgroup * COUNTER_WORDS + word];
                    scratch[subgroup * COUNTER_WORDS + word] = next;
                    next += counter;
                }
            }
            start += both.x + both.y;
        }
    }
    barrier();
    uvec2 window = shared_window;
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint digit = digit_in(window, keys[row]);
        uint first_place = scratch[counter_word(digit)] >> counter_shift(digit) & 0xFFFFu;
        places[row / 2u] += first_place << 16u * (row % 2u);
    }
    uint starts[DIGITS_EACH];
    uint counts[DIGITS_EACH];
    for (uint i = 0u; i < DIGITS_EACH; i++) {
        uint both = first + i < RADIX_DIGITS ? digits[first + i] : 0u;
        starts[i] = both & 0xFFFFu;
        counts[i] = both >> 16u;
    }
    barrier(); // the counters are dead from here
    share(keys, places, 0u);
    if (!look_back(tile, end, base, first, starts, counts)) {
        return; // nothing may be written to a wrong place
    }

    // In sorted order neighbouring invocations write neighbouring words, except where the digit changes. Four digits to
    // a word.
    uint written[(KEYS + 3u) / 4u];
    window = shared_window;
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint slot = row % ROUND_KEYS * WORKGROUP + self;
        if (row != 0u && row % ROUND_KEYS == 0u) {
            barrier(); // the round before has been read
            share(keys, places, row / ROUND_KEYS);
            barrier();
        }
        uint place = row * WORKGROUP + self;
        uint key = place < valid_keys ? scratch[slot] : 0u;
        uint digit = digit_in(window, key);
        if (place < valid_keys) {
            keys_out[place + digits[digit]] = leaving_key(key);
        }
        if (row % 4u == 0u) {
            written[row / 4u] = digit;
        } else {
            written[row / 4u] |= digit << 8u * (row % 4u);
        }
    }
    if (PAYLOADS == 0u) {
        return;
    }
    uint payloads[KEYS];
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint index = key_index(tile, row);
        payloads[row] = index < end ? payloads_in[index] : 0u;
    }
    [[unroll]] for (uint row = 0u; row < KEYS; row++) {
        uint slot = row % ROUND_KEYS * WORKGROUP + self;
        if (row % ROUND_KEYS == 0u) {
            barrier(); // the keys, or the round before, have been read
            share(payloads, places, row / ROUND_KEYS);
            barrier();
        }
        uint place = row * WORKGROUP + self;
        if (place < valid_keys) {
            uint digit = written[row / 4u] >> 8u * (row % 4u) & 0xFFu;
            payloads_out[place + digits[digit]] = scratch[slot];
        }
    }
}
