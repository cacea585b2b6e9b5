// Some layers of the networks on rows of numbers, on a CPU: the body of apply_native.
#if !defined(__CUDA_ARCH__)
#include "layers.h"
const int in = x.shape[1], count = x.shape[0], out = y.shape[1];
const int width = networks.shapes.data[4 * (first_layer + layer_count) - 3];
float* const rows_in = scratch.data;  // whole blocks: rows are read beyond the last one
float* const one = rows_in + @BLOCK * in;
float* const other = one + @BLOCK * networks.widest;
for (int first = 0; first < count; first += @BLOCK) {
    const int rows = count - first < @BLOCK ? count - first : @BLOCK;
    for (int i = 0; i < rows * in; ++i) rows_in[i] = x.data[first * in + i];
    const float* const found =
        apply_network(first_layer, layer_count, rows, {rows_in, in, 1}, in, one, other);
    for (int r = 0; r < rows; ++r)
        for (int k = 0; k < out; ++k) y.data[(first + r) * out + k] = found[r * width + k];
}
#endif
