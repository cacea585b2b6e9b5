// Layers of the networks for some samples at once, on a CPU.  Bodies of functions include this
// text (native.py), so it has lambdas in place of functions.
//
// A row is a sample's values.  A block of outputs of ROWS rows stays in registers while the inputs
// pass: each weight that is loaded serves ROWS rows, and each input all outputs of the block.
#include "lanes.h"
struct Wide { enum { VECTORS = LANES == 16 ? 4 : 2 }; };
struct Narrow { enum { VECTORS = 1 }; };
enum { ROWS = 6 };
typedef Lanes LooseLanes __attribute__((aligned(4)));

struct Layer { int in, width; const float *weights, *bias; };  // width: of its rows of weights

// Numbers of rows: from one row to the next, and from one number of a row to the next.
struct Inputs { const float* data; int row_step, step; };

// A block: y = max(x W + b, lowest), for ROWS rows and some columns.
auto block = [&](auto columns, Layer layer, Inputs x, float* y, int y_stride,
                float lowest) __attribute__((always_inline)) {
    enum { VECTORS = decltype(columns)::VECTORS };
    Lanes sums[ROWS][VECTORS];
#pragma clang loop unroll(full)
    for (int v = 0; v < VECTORS; ++v) {
        const Lanes bias = *reinterpret_cast<const LooseLanes*>(layer.bias + v * LANES);
#pragma clang loop unroll(full)
        for (int r = 0; r < ROWS; ++r) sums[r][v] = bias;
    }
    for (int k = 0; k < layer.in; ++k) {
        const float* const row = layer.weights + k * layer.width;
        const float* const inputs = x.data + k * x.step;
        Lanes weights[VECTORS];
#pragma clang loop unroll(full)
        for (int v = 0; v < VECTORS; ++v)
            weights[v] = *reinterpret_cast<const LooseLanes*>(row + v * LANES);
#pragma clang loop unroll(full)
        for (int r = 0; r < ROWS; ++r) {
            const Lanes value = inputs[r * x.row_step];
#pragma clang loop unroll(full)
            for (int v = 0; v < VECTORS; ++v)
                sums[r][v] = multiply_add(value, weights[v], sums[r][v]);
        }
    }
#pragma clang loop unroll(full)
    for (int r = 0; r < ROWS; ++r)
#pragma clang loop unroll(full)
        for (int v = 0; v < VECTORS; ++v)
            *reinterpret_cast<LooseLanes*>(y + r * y_stride + v * LANES) =
                __builtin_elementwise_max(sums[r][v], Lanes(lowest));
};

// y = max(x W + b, lowest).  Arrays have room for a multiple of ROWS rows.
auto apply_layer = [&](Layer layer, int row_count, Inputs x, float* y, float lowest) {
    for (int first = 0; first < row_count; first += ROWS) {
        const Inputs from = {x.data + first * x.row_step, x.row_step, x.step};
        float* const to = y + first * layer.width;
        Layer part = layer;
        int column = 0;
        for (; column + Wide::VECTORS * LANES <= layer.width; column += Wide::VECTORS * LANES) {
            block(Wide(), part, from, to + column, layer.width, lowest);
            part.weights += Wide::VECTORS * LANES;
            part.bias += Wide::VECTORS * LANES;
        }
        for (; column < layer.width; column += LANES) {
            block(Narrow(), part, from, to + column, layer.width, lowest);
            part.weights += LANES;
            part.bias += LANES;
        }
    }
};

// The output of a network [rows, width of the last layer]: one of two buffers.
auto apply_network = [&](int first_layer, int layer_count, int row_count, Inputs x, int in,
                         float* buffer, float* other) {
    for (int l = 0; l < layer_count; ++l) {
        const int* const shape = networks.shapes.data + 4 * (first_layer + l);
        const float* const values = networks.values.data;
        const int inputs = l == 0 ? in : shape[0];
        const Layer layer = {inputs, shape[1], values + shape[2], values + shape[3]};
        const bool last = l + 1 == layer_count;
        apply_layer(layer, row_count, x, buffer, last ? -__builtin_inff() : 0.0f);
        x = {buffer, layer.width, 1};
        buffer = other;
        other = const_cast<float*>(x.data);
    }
    return x.data;
};

// exp of each lane, to 2e-7 of itself: 2^n times a polynomial, as in Cephes.
auto exp_of = [](auto x) {
    typedef decltype(x) Numbers;
    x = __builtin_elementwise_max(x, Numbers(-87.0f));
    x = __builtin_elementwise_min(x, Numbers(88.0f));
    const auto n = __builtin_elementwise_roundeven(x * 1.44269504f);
    const auto r = (x - n * 0.693359375f) + n * 2.12194440e-4f;
    auto y = 1.9875691500e-4f * r + 1.3981999507e-3f;
    y = y * r + 8.3334519073e-3f;
    y = y * r + 4.1665795894e-2f;
    y = y * r + 1.6666665459e-1f;
    y = y * r + 5.0000001201e-1f;
    y = y * r * r + r + 1.0f;
    typedef int Ints __attribute__((ext_vector_type(sizeof(x) / 4)));
    const Ints power = (__builtin_convertvector(n, Ints) + 127) << 23;
    return y * *reinterpret_cast<const decltype(x)*>(&power);
};
