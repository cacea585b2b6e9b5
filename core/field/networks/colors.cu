// The color network on rows of h and Y(d), of any width and number of layers: the body of
// colors_native in mma.py.
//
// A block takes 64 rows at a time.  They lie in shared memory, which each layer overwrites with its
// output: a warp has all rows and a fourth of the columns in its registers, and writes them when
// all warps have read.  The weights come from global memory, through the caches, AHEAD steps ahead,
// and the inputs of the next rows a whole network ahead.
#include "tensor_cores.h"
enum { ROWS = 64, AHEAD = @AHEAD };
enum { STRIDE = @MAX_WIDTH + 8 };  // halves; rows begin at different banks
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
    uint2 b[AHEAD + 1][COUNT];
    auto load_weights = [&](uint2 (&to)[COUNT], int k) {
        k = k < k_tiles ? k : k_tiles - 1;
#pragma unroll
        for (int n = 0; n < COUNT; ++n) to[n] = __ldg(tiles + (n * k_tiles + k) * 32);
    };
#pragma unroll
    for (int j = 0; j < AHEAD; ++j) load_weights(b[j], j);
#pragma unroll
    for (int n = 0; n < COUNT; ++n)
#pragma unroll
        for (int m = 0; m < 4; ++m) start(c[m][n], biases.data + layer[3] + 8 * (first_n + n));
    for (int first_k = 0; first_k < k_tiles; first_k += AHEAD + 1)
#pragma unroll
        for (int j = 0; j <= AHEAD; ++j) {
            const int k = first_k + j;
            if (k >= k_tiles) break;
            load_weights(b[(j + AHEAD) % (AHEAD + 1)], k + AHEAD);
            Operand a[4];
#pragma unroll
            for (int m = 0; m < 4; ++m) load_rows(a[m], m, k);
#pragma unroll
            for (int n = 0; n < COUNT; ++n)
#pragma unroll
                for (int m = 0; m < 4; ++m) multiply(c[m][n], a[m], b[j][n]);
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

const int row_count = count.data[0];

// A fourth of a row, for each thread twice: h and Y(d) of 64 rows.
auto load_inputs = [&](uint4 (&to)[2], int first) {
#pragma unroll
    for (int j = 0; j < 2; ++j) {
        const int i = threadIdx.x + j * ROWS * 2, row = first + (i >> 2);
        to[j] = make_uint4(0u, 0u, 0u, 0u);
        if (row < row_count)
            to[j] = __ldg(reinterpret_cast<const uint4*>(x.data) + 4 * size_t(row) + (i & 3));
    }
};

uint4 inputs[2];
load_inputs(inputs, blockIdx.x * ROWS);
for (int first = blockIdx.x * ROWS; first < row_count; first += gridDim.x * ROWS) {
#pragma unroll
    for (int j = 0; j < 2; ++j) {
        const int i = threadIdx.x + j * ROWS * 2;
        *reinterpret_cast<uint4*>(rows + (i >> 2) * (STRIDE / 2) + 4 * (i & 3)) = inputs[j];
    }
    __syncthreads();
    load_inputs(inputs, first + gridDim.x * ROWS);  // of the next rows, meanwhile
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
#pragma unroll 4
    for (int k = 0; k < last[0]; ++k) {
        Operand a;
        load_rows(a, warp, k);
        multiply(o, a, __ldg(weights + (last[2] + k) * 32 + lane));
    }
    for (int i = 0; i < 4; ++i) {
        const int row = first + 16 * warp + group + (i >> 1) * 8, channel = pair + (i & 1);
        if (row < row_count && channel < 3)
            reinterpret_cast<float*>(rgb.data)[3 * row + channel] = 1.0f / (1.0f + expf(-o[i]));
    }
    __syncthreads();
}
