// Both networks of the usual shape, for each sample: the body of evaluate_native in mma.py.
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
enum { TILES = 76, BIASES = 216 };  // of all layers, one after another
#include "density.h"

for (int tile = blockIdx.x * (blockDim.x >> 5) + (threadIdx.x >> 5); tile * 32 < count;
     tile += warp_count) {
    if (!is_used(tile)) continue;
    const int first_row = tile * 32 + group;
    Result h[2][2];
    find_density(first_row, h);
    uint hy[2][2][4], a[2][4][4];
    float c[2][8][4];
    for (int m = 0; m < 2; ++m) {
        join(hy[m][0], h[m][0], h[m][1]);
        load(hy[m][1], reinterpret_cast<const char*>(basis.data), first_row + 16 * m, 16, 0);
    }
#pragma unroll
    for (int n = 0; n < 8; ++n)
#pragma unroll
        for (int m = 0; m < 2; ++m) {
            start(c[m][n], bias + 80 + 8 * n);
            product(c[m][n], hy[m][0], 24 + 2 * n);
            product(c[m][n], hy[m][1], 24 + 2 * n + 1);
            for (int i = 0; i < 4; ++i) c[m][n][i] = relu(c[m][n][i]);
        }
#pragma unroll
    for (int m = 0; m < 2; ++m)
        for (int k = 0; k < 4; ++k) join(a[m][k], c[m][2 * k], c[m][2 * k + 1]);
#pragma unroll
    for (int n = 0; n < 8; ++n)
#pragma unroll
        for (int m = 0; m < 2; ++m) {
            start(c[m][n], bias + 144 + 8 * n);
            for (int k = 0; k < 4; ++k) product(c[m][n], a[m][k], 40 + 4 * n + k);
            for (int i = 0; i < 4; ++i) c[m][n][i] = relu(c[m][n][i]);
        }
#pragma unroll
    for (int m = 0; m < 2; ++m) {
        for (int k = 0; k < 4; ++k) join(a[m][k], c[m][2 * k], c[m][2 * k + 1]);
        float o[4];
        start(o, bias + 208);
        for (int k = 0; k < 4; ++k) product(o, a[m][k], 72 + k);
        for (int i = 0; i < 4; ++i) {
            const int row = first_row + 16 * m + (i >> 1) * 8, channel = pair + (i & 1);
            if (row < count && channel < 3)
                reinterpret_cast<float*>(rgb.data)[3 * row + channel]
                    = 1.0f / (1.0f + expf(-o[i]));
        }
    }
}
#endif
