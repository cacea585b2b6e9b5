// The density network alone: the body of geometry_native in mma.py.
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
enum { TILES = 24, BIASES = 80 };
#include "density.h"

// An infinite number would spoil the sums of its ray, even if it weighs nothing.
auto finite = [](float v) { return fminf(fmaxf(v, -65504.0f), 65504.0f); };

for (int tile = blockIdx.x * (blockDim.x >> 5) + (threadIdx.x >> 5); tile * 32 < count;
     tile += warp_count) {
    if (!is_used(tile)) continue;
    const int first_row = tile * 32 + group;
    Result results[2][2];
    find_density(first_row, results);
#pragma unroll
    for (int m = 0; m < 2; ++m)
#pragma unroll
        for (int n = 0; n < 2; ++n)
#pragma unroll
            for (int i = 0; i < 2; ++i) {
                const int row = first_row + 16 * m + 8 * i;
                if (row < count)
                    reinterpret_cast<uint*>(h.data)[size_t(row) * 8 + 4 * n + pair / 2] =
                        halves(finite(results[m][n][2 * i]), finite(results[m][n][2 * i + 1]));
            }
}
#endif
