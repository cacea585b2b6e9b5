// Density and h of the rows whose features a warp has put: the body of density_of_rows in density_rows.py.
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
#include "tensor_cores.h"
#include "density_rows.h"
const Room& shared = *reinterpret_cast<const Room*>(room);
const uint* const mine = shared.rows[threadIdx.x - lane];
// An infinite number would spoil the sums of its ray, even if it weighs nothing.
auto finite = [](float v) { return fminf(fmaxf(v, -65504.0f), 65504.0f); };
auto product = [&](Result& c, const Operand& a, int tile) {
    multiply(c, a, shared.weights[tile * 32 + lane]);
};
__syncwarp();
#pragma unroll 1
for (int m = 0; m < 2; ++m) {  // both at once need too many registers
    Operand a[4];
#pragma unroll
    for (int k = 0; k < 2; ++k)
#pragma unroll
        for (int i = 0; i < 4; ++i)
            a[k][i] = mine[20 * (16 * m + group + (i & 1) * 8) + 8 * k + pair / 2 + (i >> 1) * 4];
    Result c[8];
#pragma unroll
    for (int j = 0; j < 8; ++j) {
        start(c[j], shared.bias + 8 * j);
        product(c[j], a[0], 2 * j);
        product(c[j], a[1], 2 * j + 1);
        for (int i = 0; i < 4; ++i) c[j][i] = relu(c[j][i]);
    }
#pragma unroll
    for (int k = 0; k < 4; ++k) join(a[k], c[2 * k], c[2 * k + 1]);
    const int row = n - lane + 16 * m + group;
#pragma unroll
    for (int j = 0; j < 2; ++j) {
        Result r;
        start(r, shared.bias + 64 + 8 * j);
#pragma unroll
        for (int k = 0; k < 4; ++k) product(r, a[k], 16 + 4 * j + k);
        uint* const to = reinterpret_cast<uint*>(h.data) + size_t(row) * 8 + 4 * j + pair / 2;
        to[0] = halves(finite(r[0]), finite(r[1]));
        to[64] = halves(finite(r[2]), finite(r[3]));
        if (j == 0 && pair == 0) {
            sigma.data[row] = expf(fminf(r[0], @MAX_LOG_SIGMA));
            sigma.data[row + 8] = expf(fminf(r[2], @MAX_LOG_SIGMA));
        }
    }
}
__syncwarp();  // the next rows overwrite these
#endif
