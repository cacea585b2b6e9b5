// The color network on rows of h and Y(d), of any width and number of layers: the body of
// colors_native in mma.py.
//
// A block takes 64 rows at a time.  They lie in shared memory, which each layer overwrites with its
// output: a warp has all rows and a fourth of the columns in its registers, and writes them when
// all warps have read.  The weights come from global memory, through the caches, a step ahead.
#include "tensor_cores.h"
enum { ROWS = 64, STRIDE = @MAX_WIDTH + 8 };  // halves; rows begin at different banks
__shared__ __align__(16) uint rows[ROWS * STRIDE / 2];

const uint2* const weights = reinterpret_cast<const uint2*>(fragments.data);
const int warp = threadIdx.x >> 5, layer_count = layers.shape[0];

struct Tiles1 { enum { COUNT = 1 }; };  // tiles of columns that a warp has, by the layer's width
struct Tiles2 { enum { COUNT = 2 }; };
struct Tiles4 { enum { COUNT = 4 }; };
struct Tiles6 { enum { COUNT = 6 }; };
struct Tiles8 { enum { COUNT = 8 }; };

// Rows 16 m .. 16 m + 15, columns 16 k .. 16 k + 15.
auto load_rows = [&](Operand& a, int m, int k) {
    const uint* const from = rows + (16 * m + group) * (STRIDE / 2) + 8 * k + pair / 2;
    a[0] = from[0];
    a[1] = from[8 * (STRIDE / 2)];
    a[2] = from[4];
    a[3] = from[8 * (STRIDE / 2) + 4];
};

// A hidden layer, in place.
auto apply_layer = [&](auto tiles_of_warp, const int* layer) {
    enum { COUNT = decltype(tiles_of_warp)::COUNT };
    const int k_tiles = layer[0], first_n = warp * COUNT;
    const uint2* const tiles = weights + (layer[2] + first_n * k_tiles) * 32 + lane;
    float c[4][COUNT][4];
    uint2 b[COUNT];
#pragma unroll
    for (int n = 0; n < COUNT; ++n) {
        b[n] = __ldg(tiles + n * k_tiles * 32);
#pragma unroll
        for (int m = 0; m < 4; ++m) start(c[m][n], biases.data + layer[3] + 8 * (first_n + n));
    }
    for (int k = 0; k < k_tiles; ++k) {
        uint2 next[COUNT];
        const int ahead = k + 1 < k_tiles ? k + 1 : k;
#pragma unroll
        for (int n = 0; n < COUNT; ++n) next[n] = __ldg(tiles + (n * k_tiles + ahead) * 32);
        Operand a[4];
#pragma unroll
        for (int m = 0; m < 4; ++m) load_rows(a[m], m, k);
#pragma unroll
        for (int n = 0; n < COUNT; ++n)
#pragma unroll
            for (int m = 0; m < 4; ++m) multiply(c[m][n], a[m], b[n]);
#pragma unroll
        for (int n = 0; n < COUNT; ++n) b[n] = next[n];
    }
    __syncthreads();
#pragma unroll
    for (int n = 0; n < COUNT; ++n)
#pragma unroll
        for (int m = 0; m < 4; ++m) {
            uint* const to =
                rows + (16 * m + group) * (STRIDE / 2) + 4 * (first_n + n) + pair / 2;
            to[0] = halves(relu(c[m][n][0]), relu(c[m][n][1]));
            to[8 * (STRIDE / 2)] = halves(relu(c[m][n][2]), relu(c[m][n][3]));
        }
    __syncthreads();
};

for (int first = blockIdx.x * ROWS; first < count; first += gridDim.x * ROWS) {
    bool wanted = false;
    const int thread = threadIdx.x;
    if (thread < ROWS && first + thread < count)
        wanted = transmittance.data[first + thread] < 1.0f;
    if (!__syncthreads_or(wanted)) continue;
    for (int i = threadIdx.x; i < ROWS * 16; i += blockDim.x) {
        const int row = first + (i >> 4);
        rows[(i >> 4) * (STRIDE / 2) + (i & 15)] =
            row < count ? reinterpret_cast<const uint*>(x.data)[size_t(row) * 16 + (i & 15)] : 0u;
    }
    __syncthreads();
    for (int l = 0; l + 1 < layer_count; ++l) {
        const int* const layer = &layers.data[4 * l];
        if (layer[1] == 32) apply_layer(Tiles8(), layer);
        else if (layer[1] == 24) apply_layer(Tiles6(), layer);
        else if (layer[1] == 16) apply_layer(Tiles4(), layer);
        else if (layer[1] == 8) apply_layer(Tiles2(), layer);
        else apply_layer(Tiles1(), layer);
    }
    // The last layer has one tile of columns: a warp takes 16 rows.
    const int* const last = &layers.data[4 * (layer_count - 1)];
    Result o;
    start(o, biases.data + last[3]);
    for (int k = 0; k < last[0]; ++k) {
        Operand a;
        load_rows(a, warp, k);
        multiply(o, a, __ldg(weights + (last[2] + k) * 32 + lane));
    }
    for (int i = 0; i < 4; ++i) {
        const int row = first + 16 * warp + group + (i >> 1) * 8, channel = pair + (i & 1);
        if (row < count && channel < 3)
            reinterpret_cast<float*>(rgb.data)[3 * row + channel] = 1.0f / (1.0f + expf(-o[i]));
    }
    __syncthreads();
}
