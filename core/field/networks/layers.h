// Layers of the networks for some samples at once, on a CPU.  Bodies of functions include this
// text (native.py), so it has lambdas in place of functions.
//
// A row is a sample's values.  A block of outputs of ROWS rows stays in registers while the inputs
// pass: each weight that is loaded serves ROWS rows, and each input all outputs of the block.
//
// Numbers of x and W are floats, or pairs: two bfloat16, those of rows 2k and 2k + 1 of W, in one
// word.  Where a processor multiplies pairs, it takes as long for one as for a float.
#include "lanes.h"
struct Wide { enum { VECTORS = LANES == 16 ? 4 : 2 }; };
struct Narrow { enum { VECTORS = 1 }; };
enum { ROWS = 6 };
typedef Ints LooseInts __attribute__((aligned(4), may_alias));
typedef int Pair __attribute__((may_alias));
typedef unsigned short Half __attribute__((may_alias));

// in: rows of weights; width: numbers of each, and of y.
struct Layer { int in, width; const float *weights, *bias; };
struct PairLayer { int in, width; const Pair* weights; const float* bias; };

// Numbers of rows: from one row to the next, and from one number of a row to the next.
struct Inputs { const float* data; int row_step, step; };
struct PairInputs { const Pair* data; int row_step, step; };

#if defined(__AVX512BF16__)
enum { HAS_PAIRS = 1 };
typedef float Floats16 __attribute__((vector_size(64)));
typedef __bf16 Halves32 __attribute__((vector_size(64)));
typedef __bf16 Halves16 __attribute__((vector_size(32), aligned(2), may_alias));
auto add_pairs = [](Ints a, Ints b, Lanes sums) __attribute__((always_inline)) {
    return (Lanes)__builtin_ia32_dpbf16ps_512((Floats16)sums, (Halves32)a, (Halves32)b);
};
auto put_halves = [](Lanes x, Half* y) __attribute__((always_inline)) {
    *reinterpret_cast<Halves16*>(y) = __builtin_convertvector((Floats16)x, Halves16);
};
#else  // nobody asks for pairs here
enum { HAS_PAIRS = 0 };
auto add_pairs = [](Ints, Ints, Lanes sums) {
    __builtin_trap();
    return sums;
};
auto put_halves = [](Lanes, Half*) { __builtin_trap(); };
#endif

auto load = [](const auto* row) __attribute__((always_inline)) {
    if constexpr (__is_same(decltype(row), const float*))
        return Lanes(*reinterpret_cast<const LooseLanes*>(row));
    else
        return Ints(*reinterpret_cast<const LooseInts*>(row));
};

// A block: y = max(x W + b, lowest), for ROWS rows and some columns.  y is of floats or of halves.
auto block = [&](auto columns, auto layer, auto x, auto* y, int y_stride,
                float lowest) __attribute__((always_inline)) {
    enum { VECTORS = decltype(columns)::VECTORS };
    constexpr bool of_pairs = __is_same(decltype(x), PairInputs);
    Lanes sums[ROWS][VECTORS];
#pragma clang loop unroll(full)
    for (int v = 0; v < VECTORS; ++v) {
        const Lanes bias = *reinterpret_cast<const LooseLanes*>(layer.bias + v * LANES);
#pragma clang loop unroll(full)
        for (int r = 0; r < ROWS; ++r) sums[r][v] = bias;
    }
    for (int k = 0; k < layer.in; ++k) {
        const auto* const row = layer.weights + k * layer.width;
        const auto* const inputs = x.data + k * x.step;
        decltype(load(row)) weights[VECTORS];
#pragma clang loop unroll(full)
        for (int v = 0; v < VECTORS; ++v) weights[v] = load(row + v * LANES);
#pragma clang loop unroll(full)
        for (int r = 0; r < ROWS; ++r) {
            const decltype(load(row)) value = inputs[r * x.row_step];
#pragma clang loop unroll(full)
            for (int v = 0; v < VECTORS; ++v)
                if constexpr (of_pairs)
                    sums[r][v] = add_pairs(value, weights[v], sums[r][v]);
                else
                    sums[r][v] = multiply_add(value, weights[v], sums[r][v]);
        }
    }
#pragma clang loop unroll(full)
    for (int r = 0; r < ROWS; ++r)
#pragma clang loop unroll(full)
        for (int v = 0; v < VECTORS; ++v) {
            const Lanes out = __builtin_elementwise_max(sums[r][v], Lanes(lowest));
            auto* const to = y + r * y_stride + v * LANES;
            if constexpr (sizeof(*y) == sizeof(Half))
                put_halves(out, to);
            else
                *reinterpret_cast<LooseLanes*>(to) = out;
        }
};

// y = max(x W + b, lowest).  Arrays hold a multiple of ROWS rows.
auto apply_layer = [&](auto layer, int row_count, auto x, auto* y, float lowest) {
    for (int first = 0; first < row_count; first += ROWS) {
        const decltype(x) from = {x.data + first * x.row_step, x.row_step, x.step};
        auto* const to = y + first * layer.width;
        auto rest = layer;  // from `column` on
        int column = 0;
        for (; column + Wide::VECTORS * LANES <= layer.width; column += Wide::VECTORS * LANES) {
            block(Wide(), rest, from, to + column, layer.width, lowest);
            rest.weights += Wide::VECTORS * LANES;
            rest.bias += Wide::VECTORS * LANES;
        }
        for (; column < layer.width; column += LANES) {
            block(Narrow(), rest, from, to + column, layer.width, lowest);
            rest.weights += LANES;
            rest.bias += LANES;
        }
    }
};

// The output of a network [rows, width of the last layer]: one of two buffers.
auto apply_network = [&](int first_layer, int layer_count, int row_count, auto x, int in,
                         float* buffer, float* other) -> const float* {
    constexpr bool of_pairs = __is_same(decltype(x), PairInputs);
    const float* const values = networks.values.data;
    for (int l = 0; l < layer_count; ++l) {
        const int* const shape = networks.shapes.data + 5 * (first_layer + l);
        const int inputs = l == 0 ? in : shape[0], width = shape[1];
        const bool last = l + 1 == layer_count;
        if constexpr (of_pairs) {
            const Pair* const weights = networks.pairs.data + shape[4];
            const PairLayer layer = {(inputs + 1) / 2, width, weights, values + shape[3]};
            if (last) {
                apply_layer(layer, row_count, x, buffer, -__builtin_inff());
                break;
            }
            apply_layer(layer, row_count, x, reinterpret_cast<Half*>(buffer), 0.0f);
            x = {reinterpret_cast<const Pair*>(buffer), width / 2, 1};
        } else {
            const Layer layer = {inputs, width, values + shape[2], values + shape[3]};
            apply_layer(layer, row_count, x, buffer, last ? -__builtin_inff() : 0.0f);
            if (last) break;
            x = {buffer, width, 1};
        }
        float* const written = buffer;
        buffer = other;
        other = written;
    }
    return buffer;
};

// Numbers of rows as pairs, one after another: x [count] -> y [count / 2].  Both hold a multiple of
// LANES.
auto pair_up = [&](const float* x, int count, Pair* y) {
    for (int i = 0; i < count; i += LANES) put_halves(load(x + i), reinterpret_cast<Half*>(y) + i);
};

// The same of columns: x [in][step] -> y [in / 2][y_step].
auto pair_columns = [&](const float* x, int step, int row_count, int in, Pair* y, int y_step) {
    for (int k = 0; k < in / 2; ++k)
        for (int r = 0; r < row_count; r += LANES) {
            const float* const row = x + 2 * k * step + r;
            const Words even = (Words)load(row), odd = (Words)load(row + step);
            // A bfloat16 is the upper half of a float; the lower half rounds, from its middle on up.
            *reinterpret_cast<LooseInts*>(y + k * y_step + r) =
                (Ints)(((even + 0x8000u) >> 16) | ((odd + 0x8000u) & 0xffff0000u));
        }
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
