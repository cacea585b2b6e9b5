// The networks on tensor cores, for 32 samples in a warp's registers: bodies of the functions in
// mma.py, each below its name and behind this head.  Of both networks or of one there are so many
// TILES of weights and BIASES.
#include "tensor_cores.h"
__shared__ uint2 weights[@TILES * 32];
__shared__ float bias[@BIASES];
for (int i = threadIdx.x; i < @TILES * 32; i += blockDim.x)
    weights[i] = reinterpret_cast<const uint2*>(fragments.data)[i];
for (int i = threadIdx.x; i < @BIASES; i += blockDim.x) bias[i] = biases.data[i];
__syncthreads();

const int count = total.data[0];
const int warp_count = gridDim.x * (blockDim.x >> 5);

auto product = [&](Result& c, const Operand& a, int tile) {
    multiply(c, a, weights[tile * 32 + lane]);
};
auto load = [&](Operand& a, const char* bytes, int row, int columns_, int column) {
    for (int i = 0; i < 4; ++i) {
        const int r = row + (i & 1) * 8, c = column + pair + (i >> 1) * 8;
        a[i] = r < count && c < columns_
            ? *reinterpret_cast<const uint*>(bytes + 2 * (size_t(r) * columns_ + c)) : 0u;
    }
};

// Whether some of 32 samples are there: row n is place n / stride of ray n % stride, which has as
// many samples as `counts` says.  The stride is a multiple of 32.
auto is_used = [&](int tile) {
    if (counts.shape[0] == 0) return true;
    const int row = 32 * tile, rays = stride.data[0];
    return __any_sync(0xffffffffu, row / rays < counts.data[row % rays + lane]) != 0;
};

// h of the rows first_row + 16 m; sigma is written.
auto find_density = [&](int first_row, Result (&h)[2][2]) {
    uint a[2][4][4];
    float c[2][8][4];
    for (int m = 0; m < 2; ++m)
        for (int k = 0; k < 2; ++k)
            load(a[m][k], reinterpret_cast<const char*>(features.data), first_row + 16 * m,
                 columns, 16 * k);
#pragma unroll
    for (int n = 0; n < 8; ++n)
#pragma unroll
        for (int m = 0; m < 2; ++m) {
            start(c[m][n], bias + 8 * n);
            product(c[m][n], a[m][0], 2 * n);
            product(c[m][n], a[m][1], 2 * n + 1);
            for (int i = 0; i < 4; ++i) c[m][n][i] = relu(c[m][n][i]);
        }
#pragma unroll
    for (int m = 0; m < 2; ++m) {
        for (int k = 0; k < 4; ++k) join(a[m][k], c[m][2 * k], c[m][2 * k + 1]);
#pragma unroll
        for (int n = 0; n < 2; ++n) {
            start(h[m][n], bias + 64 + 8 * n);
            for (int k = 0; k < 4; ++k) product(h[m][n], a[m][k], 16 + 4 * n + k);
        }
        const int row = first_row + 16 * m;
        if (pair == 0) {
            if (row < count) sigma.data[row] = expf(fminf(h[m][0][0], @MAX_LOG_SIGMA));
            if (row + 8 < count) sigma.data[row + 8] = expf(fminf(h[m][0][2], @MAX_LOG_SIGMA));
        }
    }
};

//# evaluate_native
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

//# geometry_native
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
