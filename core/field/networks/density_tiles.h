// The density network on the 32 rows of features that a warp has put into `shared`: rows group and
// group + 8 of each half of them go to `put(row, j, r)`, j being 0 or 1: 8 of the 16 numbers h.
#include "tensor_cores.h"
#include "density_rows.h"
Room& shared = *reinterpret_cast<Room*>(room);
uint* const mine = shared.rows[threadIdx.x - lane];
// An infinite number would spoil the sums of its ray, even if it weighs nothing.
auto finite = [](float v) { return fminf(fmaxf(v, -65504.0f), 65504.0f); };
auto sigma_of = [](float v) { return expf(fminf(v, @MAX_LOG_SIGMA)); };
auto product = [&](Result& c, const Operand& a, int tile) {
    multiply(c, a, shared.weights[tile * 32 + lane]);
};
auto find_density = [&](auto put) {
    __syncwarp();
#pragma unroll 1
    for (int m = 0; m < 2; ++m) {  // both at once need too many registers
        Operand a[4];
#pragma unroll
        for (int k = 0; k < 2; ++k)
#pragma unroll
            for (int i = 0; i < 4; ++i)
                a[k][i] = mine[ROW * (16 * m + group + (i & 1) * 8) + 8 * k + pair / 2 + (i >> 1) * 4];
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
        __syncwarp();  // puts may overwrite the features of these rows
#pragma unroll
        for (int j = 0; j < 2; ++j) {
            Result r;
            start(r, shared.bias + 64 + 8 * j);
#pragma unroll
            for (int k = 0; k < 4; ++k) product(r, a[k], 16 + 4 * j + k);
            put(16 * m + group, j, r);
        }
    }
    __syncwarp();  // the next rows overwrite these
};
