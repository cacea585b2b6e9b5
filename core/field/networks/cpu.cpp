// Density and color of samples from their features, on a CPU: the body of evaluate_native.
#if !defined(__CUDA_ARCH__)
#include "layers.h"
enum { JOINED = @GEOMETRY_FEATURES + @BASIS_COUNT };
const int in = 4 * features.shape[1], count = features.shape[0];
const int layer_count = networks.density_count + networks.color_count;
const int h_width = networks.shapes.data[4 * networks.density_count - 3];
const int rgb_width = networks.shapes.data[4 * layer_count - 3];
float* const joined = scratch.data;
float* const one = joined + @BLOCK * JOINED;
float* const other = one + @BLOCK * networks.widest;
float* const x = other + @BLOCK * networks.widest;  // rows that are read beyond the last one
const float* const features_of = reinterpret_cast<const float*>(features.data);
for (int first = 0; first < count; first += @BLOCK) {
    const int rows = count - first < @BLOCK ? count - first : @BLOCK;
    for (int i = 0; i < rows * in; ++i) x[i] = features_of[first * in + i];
    const float* const h = apply_network(0, networks.density_count, rows, x, in, in, one, other);
    for (int r = 0; r < rows; ++r) {
        for (int k = 0; k < @GEOMETRY_FEATURES; ++k) joined[r * JOINED + k] = h[r * h_width + k];
        for (int k = 0; k < @BASIS_COUNT; ++k)
            joined[r * JOINED + @GEOMETRY_FEATURES + k] = basis.data[first + r][k];
        const float log_sigma = h[r * h_width];
        sigma.data[first + r] = exp(log_sigma < @MAX_LOG_SIGMA ? log_sigma : @MAX_LOG_SIGMA);
    }
    const float* const y = apply_network(networks.density_count, networks.color_count, rows,
                                         joined, JOINED, JOINED, one, other);
    for (int r = 0; r < rows; ++r)
        for (int k = 0; k < 3; ++k)
            rgb.data[first + r][k] = 1.0f / (1.0f + exp(-y[r * rgb_width + k]));
}
#endif
