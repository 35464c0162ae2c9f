// Times of CUB's device-wide scan and radix sort on the same keys and sizes as `tyndall bench scan|sort`, as CSV:
// what,items,entropy,ms,p10_ms,p90_ms. scripts/gpu-check builds and runs it.
//
//   cub FROM TO STEP RUNS ANDS...     sizes 2^FROM .. 2^TO; keys are the AND of so many random words
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cub/cub.cuh>
#include <vector>

#define CHECK(call)                                                                                                    \
    do {                                                                                                               \
        cudaError_t result = (call);                                                                                   \
        if (result != cudaSuccess) {                                                                                   \
            fprintf(stderr, "cub: %s: %s\n", #call, cudaGetErrorString(result));                                       \
            exit(1);                                                                                                   \
        }                                                                                                              \
    } while (0)

// The numbers of glsl/include/rng.glsl.
__host__ __device__ uint32_t pcg_hash(uint32_t v) {
    uint32_t state = v * 747796405u + 2891336453u;
    uint32_t word = ((state >> ((state >> 28) + 4)) ^ state) * 277803737u;
    return (word >> 22) ^ word;
}

__global__ void make_keys(uint32_t* keys, uint32_t count, uint32_t ands) {
    uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= count) return;
    uint32_t key = 0xFFFFFFFFu;
    for (uint32_t k = 0; k < ands; k++) {
        uint32_t stream = pcg_hash(i ^ pcg_hash(k ^ pcg_hash(0u ^ pcg_hash(0u))));
        key &= pcg_hash(stream + 2654435769u);
    }
    keys[i] = key;
}

__global__ void heat_copy(const uint4* from, uint4* to) {
    size_t i = size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    to[i] = from[i];
}

constexpr int WARM_UPS = 3;
// As in src/bench/mod.rs: the GPU is kept busy before each run, here so long that all of a run has been launched when it begins:
// else small inputs would be timed by the host's launches.
constexpr float HEAT_MS = 2.0f;
constexpr float WARM_UP_MS = 400.0f;
constexpr size_t HEAT_WORDS = size_t(1) << 24;

struct Heat {
    uint4 *from, *to;
    int copies = 1;
    cudaEvent_t start, end;

    Heat() {
        CHECK(cudaMalloc(&from, HEAT_WORDS * 4));
        CHECK(cudaMalloc(&to, HEAT_WORDS * 4));
        CHECK(cudaMemset(from, 0, HEAT_WORDS * 4));
        CHECK(cudaEventCreate(&start));
        CHECK(cudaEventCreate(&end));
        for (float ms = 0; ms < WARM_UP_MS;) {
            float taken = std::max(work(), 1e-3f);
            ms += taken;
            copies = std::min(std::max(int(std::ceil(HEAT_MS * copies / taken)), 1), 100);
        }
    }

    void launch() {
        for (int i = 0; i < copies; i++) heat_copy<<<HEAT_WORDS / 4 / 256, 256>>>(from, to);
        CHECK(cudaGetLastError());
    }

    // ms of a launch.
    float work() {
        CHECK(cudaEventRecord(start));
        launch();
        CHECK(cudaEventRecord(end));
        CHECK(cudaEventSynchronize(end));
        float ms;
        CHECK(cudaEventElapsedTime(&ms, start, end));
        return ms;
    }
};

// Times `run` alone, after `prepare`.
template <class Prepare, class Run>
void time_runs(Heat& heat, const char* what, uint32_t count, double entropy, int runs, Prepare prepare, Run run) {
    cudaEvent_t start, end;
    CHECK(cudaEventCreate(&start));
    CHECK(cudaEventCreate(&end));
    std::vector<float> times;
    for (int i = 0; i < WARM_UPS + runs; i++) {
        heat.launch();
        prepare();
        CHECK(cudaEventRecord(start));
        CHECK(run());
        CHECK(cudaEventRecord(end));
        CHECK(cudaEventSynchronize(end));
        float ms;
        CHECK(cudaEventElapsedTime(&ms, start, end));
        if (i >= WARM_UPS) times.push_back(ms);
    }
    std::sort(times.begin(), times.end());
    auto at = [&](double share) {
        double place = share * (times.size() - 1);
        size_t low = size_t(place), high = std::min(low + 1, times.size() - 1);
        return times[low] + (times[high] - times[low]) * (place - low);
    };
    printf("%s,%u,", what, count);
    if (entropy >= 0) printf("%.6f", entropy);
    printf(",%.6f,%.6f,%.6f\n", at(0.5), at(0.1), at(0.9));
    fflush(stdout);
    CHECK(cudaEventDestroy(start));
    CHECK(cudaEventDestroy(end));
}

int main(int argc, char** argv) {
    if (argc < 6) {
        fprintf(stderr, "usage: cub FROM TO STEP RUNS ANDS...\n");
        return 2;
    }
    int from = atoi(argv[1]), to = atoi(argv[2]), step = atoi(argv[3]), runs = atoi(argv[4]);
    size_t most = size_t(1) << to;
    uint32_t *unsorted, *keys_in, *keys_out, *values_in, *values_out;
    for (uint32_t** buffer : {&unsorted, &keys_in, &keys_out, &values_in, &values_out}) {
        CHECK(cudaMalloc(buffer, most * sizeof(uint32_t)));
    }
    size_t scratch_bytes = 0, bytes = 0;
    CHECK(cub::DeviceScan::ExclusiveSum(nullptr, bytes, keys_in, keys_out, int(most)));
    scratch_bytes = std::max(scratch_bytes, bytes);
    cub::DoubleBuffer<uint32_t> probe_keys(keys_in, keys_out), probe_values(values_in, values_out);
    CHECK(cub::DeviceRadixSort::SortKeys(nullptr, bytes, probe_keys, int(most)));
    scratch_bytes = std::max(scratch_bytes, bytes);
    CHECK(cub::DeviceRadixSort::SortPairs(nullptr, bytes, probe_keys, probe_values, int(most)));
    scratch_bytes = std::max(scratch_bytes, bytes);
    void* scratch;
    CHECK(cudaMalloc(&scratch, scratch_bytes));

    Heat heat;
    printf("what,items,entropy,ms,p10_ms,p90_ms\n");
    for (int e = from; e <= to; e += step) {
        uint32_t n = 1u << e;
        make_keys<<<(n + 255) / 256, 256>>>(keys_in, n, 1);
        time_runs(heat, "copy", n, -1, runs, [] {}, [&] {
            return cudaMemcpyAsync(keys_out, keys_in, n * sizeof(uint32_t), cudaMemcpyDeviceToDevice);
        });
        time_runs(heat, "scan", n, -1, runs, [] {}, [&] {
            return cub::DeviceScan::ExclusiveSum(scratch, scratch_bytes, keys_in, keys_out, int(n));
        });
        for (int a = 5; a < argc; a++) {
            uint32_t ands = uint32_t(atoi(argv[a]));
            double one = std::pow(0.5, ands), zero = 1 - one;
            double entropy = -one * std::log2(one) - zero * std::log2(zero);
            make_keys<<<(n + 255) / 256, 256>>>(unsorted, n, ands);
            // Values are written too, as in the bench: then both are in the cache, where they fit.
            auto prepare = [&] {
                CHECK(cudaMemcpyAsync(keys_in, unsorted, n * sizeof(uint32_t), cudaMemcpyDeviceToDevice));
                CHECK(cudaMemcpyAsync(values_in, unsorted, n * sizeof(uint32_t), cudaMemcpyDeviceToDevice));
            };
            time_runs(heat, "sort keys", n, entropy, runs, prepare, [&] {
                cub::DoubleBuffer<uint32_t> keys(keys_in, keys_out);
                return cub::DeviceRadixSort::SortKeys(scratch, scratch_bytes, keys, int(n));
            });
            time_runs(heat, "sort pairs", n, entropy, runs, prepare, [&] {
                cub::DoubleBuffer<uint32_t> keys(keys_in, keys_out), values(values_in, values_out);
                return cub::DeviceRadixSort::SortPairs(scratch, scratch_bytes, keys, values, int(n));
            });
        }
    }
    return 0;
}
