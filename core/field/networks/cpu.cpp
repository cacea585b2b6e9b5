// Some layers of the networks on rows of numbers, on a CPU: the body of apply_native.
#if !defined(__CUDA_ARCH__)
#include "layers.h"
const bool by_pairs = HAS_PAIRS && in_pairs;
const int in = x.shape[1], count = x.shape[0], out = y.shape[1];
const int width = networks.shapes.data[5 * (first_layer + layer_count) - 4];
float* const rows_in = scratch.data;  // whole blocks: rows are read beyond the last one
Pair* const pairs = reinterpret_cast<Pair*>(rows_in + @BLOCK * in);
float* const one = rows_in + 2 * @BLOCK * in;
float* const other = one + @BLOCK * networks.widest;
for (int first = 0; first < count; first += @BLOCK) {
    const int rows = count - first < @BLOCK ? count - first : @BLOCK;
    for (int i = 0; i < rows * in; ++i) rows_in[i] = x.data[first * in + i];
    const Inputs from = {rows_in, in, 1};
    const PairInputs from_pairs = {pairs, in / 2, 1};
    if (by_pairs) pair_up(rows_in, rows * in, pairs);
    const float* const found = by_pairs
        ? apply_network(first_layer, layer_count, rows, from_pairs, in, one, other)
        : apply_network(first_layer, layer_count, rows, from, in, one, other);
    for (int r = 0; r < rows; ++r)
        for (int k = 0; k < out; ++k) y.data[(first + r) * out + k] = found[r * width + k];
}
#endif
