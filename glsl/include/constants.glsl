#ifndef CONSTANTS_GLSL
#define CONSTANTS_GLSL

// Iterations that one invocation may run, all its loops together. lavapipe leaves every loop silently at 65,535.
const uint MAX_ITERATIONS = 32000u;
// Loop iterations that one look-back may take: half of them, the rest is the kernel's.
const uint LOOKBACK_BUDGET = 16000u;
// What one fallback is charged: its loops (the tile's items per invocation and workgroup sums) must stay below.
const uint FALLBACK_STEPS = 64u;

// Shared memory that every device must offer, in bytes.
const uint SHARED_BYTES = 32768u;
// Workgroups along one axis of a grid that every device takes.
const uint MAX_GRID = 65535u;

// Push constant in place of a count: the count is in the arguments that dispatch_args.comp wrote.
const uint COUNT_ON_DEVICE = 4294967295u;
// Word of dispatch_args.comp's output with the clamped count; words 0 to 2 are an indirect dispatch.
const uint ARGS_COUNT = 3u;
// Words of dispatch_args.comp's output.
const uint ARGS_WORDS = 4u;

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

// CARRY: one dispatch does all; tiles look back for what comes before them.
const uint CARRY_LOOK_BACK = 0u;
// CARRY: the first of three dispatches: tiles write their sums, and nothing else. The second is column_scan.comp.
const uint CARRY_COUNT = 1u;
// CARRY: the third of three dispatches: tiles read what comes before them.
const uint CARRY_GIVEN = 2u;

// Bits of a radix sort digit.
const uint RADIX_BITS = 8u;
// Values of a radix sort digit.
const uint RADIX_DIGITS = 256u;
// Most passes of a radix sort: all bits of a u32.
const uint RADIX_PASSES = 4u;
// Words of a radix sort's `status` before the rows: a ticket per pass, then what each pass's keys are like.
const uint RADIX_HEAD = 8u;
// What a pass's keys are like: they all have the same digit.
const uint RADIX_ALIKE = 1u;
// A digit is frequent. (0: none is.)
const uint RADIX_SKEWED = 2u;
// A digit is frequent if more than one key in so many has it.
const uint RADIX_FREQUENT = 8u;
// Vectors of a lane's run that scan.comp adds up in one iteration.
const uint SCAN_RUN_VECTORS = 8u;
// Most vectors of four keys of a run of radix_runs.comp.
const uint RADIX_RUN_VECTORS = 512u;
// Keys that an invocation of radix_histogram.comp has under way together.
const uint RADIX_STEP_KEYS = 16u;
// How often it may take so many: the loops over all passes stay within half of MAX_ITERATIONS then.
const uint RADIX_STEPS_MAX = 240u;
// KEY_KIND: the key is a u32.
const uint KEY_U32 = 0u;
// KEY_KIND: the key is the bits of an i32.
const uint KEY_I32 = 1u;
// KEY_KIND: the key is the bits of an f32, in the order of IEEE 754's totalOrder.
const uint KEY_F32 = 2u;

// Factor on two scalars before their difference is divided: the difference of any two floats times it is below 2^126, beyond
// which devices divide by zero in place of a number (Vulkan, precision of OpFDiv).
const float DIFFERENCE_SCALE = 0.0625;

// Voxels along the edge of a macrocell of the path tracer.
const uint CELL_SIZE = 8u;
// Voxels along the edge of a macrocell of the rays that march: the fastest measured (docs/proxy.md).
const uint SKIP_SIZE = 4u;
// Word of a list's header: the number of items in the list.
const uint LIST_COUNT = 0u;
// Most voxels along the edge of a block of the light grid: mark.comp looks no farther than the next macrocell.
const uint MAX_LIGHT_EDGE = 4u;
// LISTED: voxels with extinction; of larger blocks, those that have such voxels.
const uint LISTED_VOXELS = 0u;
// LISTED: nodes that are a corner of a cell with extinction.
const uint LISTED_NODES = 1u;
// LISTED: cells with extinction.
const uint LISTED_CELLS = 2u;
// LISTED: of those, the ones that the eye sees (see.comp).
const uint LISTED_SEEN = 3u;
// LISTED: the other cells with extinction, but for the remote ones.
const uint LISTED_HIDDEN = 4u;
// LISTED: cells with extinction out of the eye's reach: its rays end before they come into their block of cells, or into one
// beside it. What is stored for one cell depends on its neighbours (project_solve.comp).
const uint LISTED_REMOTE = 5u;
// Bit of a block's first cell: a ray of the eye reaches the block. It is no list.
const uint MARK_REACHED = 6u;
// Cells along the edge of these blocks.
const uint REACH_BLOCK = 2u;

// Points of a cell.
const uint CELL_POINTS = 8u;
// Stream of the random numbers that place the points.
const uint CELL_STREAM = 1128614988u;
// Points of a cell at which each delta light is sampled.
const uint LIGHT_POINTS = 4u;

// EMITTED: nothing.
const uint EMITTED_NOTHING = 0u;
// EMITTED: emission by σ_a L_e.
const uint EMITTED_EMISSION = 1u;
// EMITTED: the transfer function's colour is the source function.
const uint EMITTED_COLOR = 2u;

// Largest distance to an occupied macrocell that paths make use of, in cells.
const uint MAX_EMPTINESS = 32u;
// Largest distance by octant, in cells: all bits of its OCTANT_BITS.
const uint MAX_OCTANT = 15u;
// Bits of a distance by octant.
const uint OCTANT_BITS = 4u;
// Length of the first step of a ray that starts in the medium, and by how much the next ones are longer, in whole steps.
const float NEAR_STEP = 0.25;
// Samples of a step where optical depths count, at Gauss's points (march.glsl).
const uint STEP_SAMPLES = 2u;
// A medium that lets less than the rest of the light behind it through hides it (camera.comp).
const float OPAQUE = 0.98;
// Stands for NaN in the scalars: such voxels are empty.
const float NO_VALUE = -3.4028235e38;

// Largest finite half float that fields may hold; greater values are cut off.
const float MAX_HALF = 65504.0;

// Values of a channel's code in the proxy's colours.
const uint CODES = 256u;
// Square of the largest code: what the codes of light are measured in, since they are its square roots.
const uint CODE_SQUARE = 65025u;
// Word of the proxy's control block: mask of the colour bits that the hash keeps now; of an adaptive mask the tolerance, as
// a float's bits.
const uint PROXY_MASK = 0u;
// Word of the proxy's control block: number of runs.
const uint PROXY_RUNS = 1u;
// Word of the proxy's control block: number of buckets.
const uint PROXY_BUCKETS = 2u;
// Word of the proxy's control block: 1 while the runs do not fit and a coarser mask must be tried.
const uint PROXY_RETRY = 3u;
// Word of the proxy's control block: runs that the last attempt found, whether they fitted or not.
const uint PROXY_FOUND = 4u;
// First of four words of the proxy's control block: levels of every channel.
const uint PROXY_LEVELS = 5u;
// Word of the proxy's control block: runs that are sorted by the bits of their hash beyond EARLY_BITS: all or none.
const uint PROXY_LATE_RUNS = 9u;
// Words of the proxy's control block.
const uint PROXY_WORDS = 10u;
// Bits of a hash that the sort always takes where only the GPU knows their number. Two digits, so that the result is in place.
const uint EARLY_BITS = 16u;

// First word of the quantiser's levels: one for every channel and code.
const uint QUANTISER_LEVELS = 0u;
// First word of the lowest codes of its levels, for every channel and level.
const uint QUANTISER_FLOORS = 1024u;
// First word of what the level of a code stands for, for every channel and code: a float's bits, in squares of codes for R,
// G and B, in codes for A.
const uint QUANTISER_VALUES = 2048u;
// Words of the quantiser.
const uint QUANTISER_WORDS = 3072u;
// Row of the histogram of colours after those of R, G and B: codes of A, every voxel weighted by the square of its light.
const uint HISTOGRAM_ENERGY = 3u;
// Row of the histogram: codes of A, weighted by the light.
const uint HISTOGRAM_LIGHT = 4u;
// Row of the histogram: codes of A, the number of voxels.
const uint HISTOGRAM_VOXELS = 5u;
// Rows of the histogram of colours, of CODES sums in two words each, the lower one first.
const uint HISTOGRAM_ROWS = 6u;
// Limits to the error of a level that an adaptive mask tries; the one with the fewest levels is taken.
const uint ADAPTIVE_CAPS = 64u;
// From one limit to the next: the last is below a CODES-th of the first, so that all levels together cannot exceed that one.
const float ADAPTIVE_STEP = 0.915;
// Least tolerance of an adaptive mask that is tried where the runs do not fit; it doubles from attempt to attempt.
const float ADAPTIVE_COARSER = 0.015625;

// ENVIRONMENT: no light from all around.
const uint ENVIRONMENT_NONE = 0u;
// ENVIRONMENT: the same radiance from everywhere.
const uint ENVIRONMENT_CONSTANT = 1u;
// ENVIRONMENT: a latitude-longitude image.
const uint ENVIRONMENT_IMAGE = 2u;

// BACKGROUND: nothing is behind the medium; alpha is its opacity.
const uint BACKGROUND_TRANSPARENT = 0u;
// BACKGROUND: one colour.
const uint BACKGROUND_COLOR = 1u;
// BACKGROUND: the environment.
const uint BACKGROUND_ENVIRONMENT = 2u;

// What a path does next: draw a camera ray.
const uint PATH_START = 0u;
// What a path does next: fly on to a collision.
const uint PATH_FLIGHT = 1u;
// What a path does next: follow a ray to a light.
const uint PATH_SHADOW = 2u;
// Word of the path tracer's tally: pixels that are not done with their round.
const uint TALLY_UNFINISHED = 0u;
// Word of the tally: samples done by the latest dispatch.
const uint TALLY_SAMPLES = 1u;
// Word of the tally: voxels with extinction.
const uint TALLY_ACTIVE = 2u;
// Words of the tally.
const uint TALLY_WORDS = 3u;

// SOURCE: light of one order, as the projection stores it for all directions.
const uint SOURCE_PROJECTED = 0u;
// SOURCE: emission, as classification stores it.
const uint SOURCE_EMITTED = 1u;
// SOURCE: order 1 of one delta light, as the projection stores it but for the phase function.
const uint SOURCE_LIGHT = 2u;

// SAMPLING: N directions from the phase function.
const uint SAMPLING_PHASE = 0u;
// SAMPLING: the N of M candidates with the most proxy energy.
const uint SAMPLING_TOP = 1u;
// SAMPLING: N of M candidates drawn in proportion to their proxy energy.
const uint SAMPLING_RESAMPLE = 2u;
// SAMPLING: M directions in the proxy, and N others of which the difference to the proxy is traced.
const uint SAMPLING_RESIDUAL = 3u;

// Stream of the random numbers of the pilot's first replicate; the others follow.
const uint PILOT_STREAM = 1346980943u;
// Estimates of the same mean that the pilot makes in every cell: what two of them differ by is their variance.
const uint PILOT_REPLICATES = 2u;

// STRUCTURE: uniform steps, nothing is skipped.
const uint STRUCTURE_NONE = 0u;
// STRUCTURE: macrocells, crossed one by one.
const uint STRUCTURE_CELLS = 1u;
// STRUCTURE: Chebyshev distance of every macrocell to extinction.
const uint STRUCTURE_DISTANCE = 2u;
// STRUCTURE: the largest empty node of an octree around every macrocell.
const uint STRUCTURE_OCTREE = 3u;
// STRUCTURE: distances by octant, as the renderer's rays.
const uint STRUCTURE_OCTANTS = 4u;
// STRUCTURE: the same, all rays of an invocation in one loop.
const uint STRUCTURE_FLAT = 5u;
// STRUCTURE: runs of equal bucketIDs, compared voxel by voxel: the paper's.
const uint STRUCTURE_RUNS = 6u;
// STRUCTURE: the largest aligned cube of equal bucketIDs around every voxel.
const uint STRUCTURE_CUBES = 7u;
// STRUCTURE: nearest reads of bucketIDs in fixed steps, as gather_proxy.comp.
const uint STRUCTURE_BUCKETS = 8u;
// STRUCTURE: nearest reads of light and extinction in fixed steps.
const uint STRUCTURE_VOXELS = 9u;
// STRUCTURE: full, half and quarter resolution in steps that grow with them, trilinear.
const uint STRUCTURE_MIPS = 10u;
// STRUCTURE: the same by nearest reads.
const uint STRUCTURE_NEAREST_MIPS = 11u;

// Stage of cubes.comp: copies the values.
const uint CUBES_COPY = 0u;
// Stage of cubes.comp: merges eight cubes into one.
const uint CUBES_MERGE = 1u;
// Stage of cubes.comp: tells every voxel its largest cube.
const uint CUBES_SPREAD = 2u;
// Bits of a word of cubes.comp that hold the value; those above hold the cube's level.
const uint CUBES_VALUE_BITS = 28u;
// Largest level of a cube: 2^8 voxels along its edge.
const uint CUBES_LEVELS = 8u;

#endif
