// What every kernel for a pass of the radix sort has: buffers, digits of keys, and the look-back for where the tile's keys of each
// digit go. The kernels differ in how they rank the keys of a tile.
//
// Contract. The including kernel defines, before it includes this,
//     KEYS          of an invocation, specialization id 4; a tile has WORKGROUP * KEYS
//     COUNT_STEPS   iterations that count_share takes at most, and some 16 for what is around it
//     DIGITS_LOOP   attributes of loops over an invocation's digits, if any
// and then
//     void count_share(uint tile, uint end)    // adds the digits of the invocation's share of any tile's keys to `digits`, by count_digit;
//                                              // any partition of the tile over the workgroup will do; no barrier
// and has its own tile by take_tile(pass).
// Buffers: keys_in, payloads_in -> keys_out, payloads_out (not the same memory); status (zero before the first pass):
//   RADIX_PASSES tickets and as many words that say what each pass's keys are like, then per pass `rows` rows of
//   RADIX_DIGITS words: row 0 from radix_scan.comp, row t + 1 of tile t. Counts stay below 2^30, the width of a status
//   word's value.
#ifndef RADIX_PASS_GLSL
#define RADIX_PASS_GLSL
#ifndef DIGITS_LOOP
#define DIGITS_LOOP
#endif
#define ITEM_COUNT_BINDING 4
#define STATUS_BINDING 5
#include "item_count.glsl"
#include "radix.glsl"
#include "tile_status.glsl"

// Whether keys have payloads; without, the buffers of payloads are not touched.
layout(constant_id = 7) const uint PAYLOADS = 1u;
// Status words that a step of look-back loads at once, so that their latencies overlap.
layout(constant_id = 10) const uint AHEAD = 1u;
// What the keys are and their order, see radix.glsl. The first pass turns keys into images, the last one turns them back:
// between them all is as for u32, ascending.
layout(constant_id = 11) const uint KEY_KIND = KEY_U32;
layout(constant_id = 12) const uint DESCENDING = 0u;

layout(set = 0, binding = 0, scalar) readonly buffer KeysIn { uint keys_in[]; };
layout(set = 0, binding = 1, scalar) readonly buffer PayloadsIn { uint payloads_in[]; };
layout(set = 0, binding = 2, scalar) writeonly buffer KeysOut { uint keys_out[]; };
layout(set = 0, binding = 3, scalar) writeonly buffer PayloadsOut { uint payloads_out[]; };

layout(push_constant, scalar) uniform RadixPassPush {
    uint count; // pairs, or COUNT_ON_DEVICE
    uint pass;
    uint passes;
    uint bit_begin;
    uint bit_end;
    uint digit_bits; // of a pass
    uint rows; // status rows per pass
};

const uint TILE = WORKGROUP * KEYS;
const uint DIGITS_EACH = (RADIX_DIGITS + WORKGROUP - 1u) / WORKGROUP;
const uint NO_ROW = 0xFFFFFFFFu;

// Per digit: what the kernel keeps there, then (fallback) a blocking tile's count, then what to add to a place among the tile's keys to
// get the place in the output.
shared uint digits[RADIX_DIGITS];
// Highest status row that somebody misses, 0: none; NO_ROW: somebody has run out of budget, or misses row 0. Zero before look_back.
shared uint shared_blocking;

void count_share(uint tile, uint end);

uint digit_at(uint key) {
    return digit_in(digit_window(pass, bit_begin, bit_end, digit_bits), key);
}

// A key that was read, as the passes between first and last see it.
uint entering_key(uint key) {
    return pass == 0u ? image_of_key(key, KEY_KIND, DESCENDING) : key;
}

uint load_key(uint index) {
    return entering_key(keys_in[index]);
}

// What the pass writes of it.
uint leaving_key(uint key) {
    return pass + 1u == passes ? key_of_image(key, KEY_KIND, DESCENDING) : key;
}

// The tile's share of a pass whose digit all keys share: nothing to count.
void copy_tile(uint tile, uint end) {
    if (CARRY == CARRY_COUNT) {
        return;
    }
    for (uint i = tile * TILE + linear_index(); i < min(end, (tile + 1u) * TILE); i += WORKGROUP) {
        keys_out[i] = leaving_key(load_key(i));
        if (PAYLOADS != 0u) {
            payloads_out[i] = payloads_in[i];
        }
    }
}

void count_digit(uint key) {
    atomicAdd(digits[digit_at(key)], 1u, gl_ScopeWorkgroup, 0, 0);
}

// Counts the digits of a tile in `digits`: what its owner would have published. Resets `shared_blocking`.
void count_digits(uint tile, uint end) {
    barrier(); // `shared_blocking` may still be read
    if (linear_index() == 0u) {
        shared_blocking = 0u;
    }
    for (uint i = linear_index(); i < RADIX_DIGITS; i += WORKGROUP) {
        digits[i] = 0u;
    }
    barrier();
    count_share(tile, end);
    barrier();
}

// Looks back for the invocation's digits [first, first + DIGITS_EACH): how many keys come before the tile's in the output, those of
// smaller digits and those of the same digit in earlier tiles; or reads what the dispatch before has summed up. Leaves in `digits` that
// less the digit's first place in the tile. Publishes the sums with the tile's own `counts` as soon as they are known: others wait for
// them. Ends with a barrier. False: out of budget, reported.
bool look_back(uint tile, uint end, uint base, uint first, uint starts[DIGITS_EACH], uint counts[DIGITS_EACH]) {
    if (CARRY == CARRY_GIVEN) {
        // Summed up from row 0, whose state has come along.
        DIGITS_LOOP for (uint i = 0u; i < DIGITS_EACH; i++) {
            if (first + i < RADIX_DIGITS) {
                digits[first + i] = (status[base + (tile + 1u) * RADIX_DIGITS + first + i] & VALUE_MASK) - starts[i];
            }
        }
        barrier();
        return true;
    }
    uint before[DIGITS_EACH];
    uint row[DIGITS_EACH]; // the status row to look at next, NO_ROW = done
    DIGITS_LOOP for (uint i = 0u; i < DIGITS_EACH; i++) {
        before[i] = 0u;
        row[i] = first + i < RADIX_DIGITS ? tile : NO_ROW;
    }
    uint steps = 0u;
    uint spins = 0u;
    uint fallbacks = 0u;
    bool failed = false;
    for (;;) {
        uint blocking = 0u; // highest row that is missing
        DIGITS_LOOP for (uint i = 0u; i < DIGITS_EACH; i++) {
            uint polls = 0u;
            while (row[i] != NO_ROW && polls <= SPIN_LIMIT && steps < LOOKBACK_BUDGET) {
                uint words[AHEAD];
                [[unroll]] for (uint k = 0u; k < AHEAD; k++) {
                    // Row 0 is inclusive: what would come before it is not looked at.
                    words[k] = load_status(base + (row[i] - min(k, row[i])) * RADIX_DIGITS + first + i);
                }
                bool goes_on = true;
                [[unroll]] for (uint k = 0u; k < AHEAD; k++) {
                    uint state = words[k] >> STATE_SHIFT;
                    if (goes_on && state != STATE_NONE) {
                        before[i] += words[k] & VALUE_MASK;
                        row[i] = state == STATE_INCLUSIVE ? NO_ROW : row[i] - 1u;
                        polls = 0u;
                        if (state == STATE_INCLUSIVE && may_publish(tile)) {
                            uint own = base + (tile + 1u) * RADIX_DIGITS + first + i;
                            publish_status(own, STATE_INCLUSIVE, before[i] + counts[i]);
                        }
                    } else if (goes_on) {
                        polls++;
                        spins++;
                    }
                    goes_on = goes_on && state == STATE_READY;
                }
                steps += AHEAD;
            }
            blocking = max(blocking, row[i] == NO_ROW ? 0u : row[i]);
        }
        DIGITS_LOOP for (uint i = 0u; i < DIGITS_EACH; i++) {
            // Row 0 is complete before this dispatch begins, and is never waited for.
            bool stuck = row[i] == 0u || (row[i] != NO_ROW && steps >= LOOKBACK_BUDGET);
            blocking = stuck ? NO_ROW : blocking;
            if (first + i < RADIX_DIGITS) {
                digits[first + i] = before[i] - starts[i];
            }
        }
        if (blocking != 0u) {
            atomicMax(shared_blocking, blocking, gl_ScopeWorkgroup, 0, 0);
        }
        barrier();
        blocking = shared_blocking;
        failed = blocking == NO_ROW;
        if (failed || blocking == 0u) {
            break;
        }
        count_digits(blocking - 1u, end);
        DIGITS_LOOP for (uint i = 0u; i < DIGITS_EACH; i++) {
            if (row[i] == blocking) {
                uint counted = digits[first + i];
                publish_status(base + blocking * RADIX_DIGITS + first + i, STATE_READY, counted);
                before[i] += counted;
                row[i] = blocking - 1u;
            }
        }
        steps += COUNT_STEPS;
        fallbacks++;
    }
    spins = subgroupAdd(spins);
    if (subgroupElect()) {
        report_lookback(spins, gl_SubgroupID == 0u ? fallbacks : 0u);
        if (failed) {
            report_error(ERROR_BUDGET);
        }
    }
    return !failed;
}
#endif
