#ifndef CONSTANTS_GLSL
#define CONSTANTS_GLSL

// Iterations that one invocation may run, all its loops together. lavapipe leaves every loop silently at 65,535.
const uint MAX_ITERATIONS = 32000u;

// Shared memory that every device must offer, in bytes.
const uint SHARED_BYTES = 32768u;
// Workgroups along one axis of a grid that every device takes.
const uint MAX_GRID = 65535u;

// Push constant in place of a count: the count is in the arguments that dispatch_args.comp wrote.
const uint COUNT_ON_DEVICE = 4294967295u;
// Word of dispatch_args.comp's output with the clamped count; words 0 to 2 and 4 to 6 are indirect dispatches.
const uint ARGS_COUNT = 3u;
// Words of dispatch_args.comp's output.
const uint ARGS_WORDS = 7u;

// Word of `diagnostics`: polls that found a status word missing.
const uint DIAGNOSTICS_SPINS = 0u;
// Word of `diagnostics`: tiles computed in place of their owner.
const uint DIAGNOSTICS_FALLBACKS = 1u;
// Word of `diagnostics`: ERROR_* bits.
const uint DIAGNOSTICS_ERRORS = 2u;
// Words of `diagnostics`.
const uint DIAGNOSTICS_WORDS = 3u;
// Look-back ran out of its loop budget: the output is incomplete.
const uint ERROR_BUDGET = 1u;
// A count on the GPU exceeds the capacity: the rest was left out.
const uint ERROR_COUNT = 2u;
// Subgroups are not full, or smaller than SUBGROUP_MIN: nothing was computed.
const uint ERROR_SUBGROUPS = 4u;

// Word of lookback.glsl's `status` that counts tickets.
const uint LOOKBACK_TICKET = 0u;
// Words of lookback.glsl's `status` before those of the tiles.
const uint LOOKBACK_HEAD = 1u;

// Bits of a radix sort digit.
const uint RADIX_BITS = 8u;
// Values of a radix sort digit.
const uint RADIX_DIGITS = 256u;
// Most passes of a radix sort: all bits of a u32. Also the words of its `status` before the rows, a ticket each.
const uint RADIX_PASSES = 4u;

#endif
