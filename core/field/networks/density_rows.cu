// The density network of 32 samples whose features a warp has put into its block's shared memory:
// bodies of the functions in density_rows.py, each below its name and behind this head.
#include "tensor_cores.h"
enum {
    ROW = 20,  // words from one to the next: 8 rows begin at different banks
    SIGMA = 16,  // behind the features
};
struct Shared {
    uint2 weights[24 * 32];
    float bias[80];
    __align__(16) uint rows[@BLOCK_SIZE][ROW];  // of each thread: 32 halves, and more
};
auto memory_at = [](wp::uint64 address) -> Shared& { return *reinterpret_cast<Shared*>(address); };

// An infinite number would spoil the sums of its ray, even if it weighs nothing.
auto finite = [](float v) { return fminf(fmaxf(v, -65504.0f), 65504.0f); };
auto sigma_of = [](float v) { return expf(fminf(v, @MAX_LOG_SIGMA)); };

// Rows group and group + 8 of each half of a warp's rows go to `put(row, j, r)`, j being 0 or 1: 8
// of the 16 numbers h.
auto find_density = [&](Shared& memory, auto put) {
    const uint* const mine = memory.rows[threadIdx.x - lane];
    auto product = [&](Result& c, const Operand& a, int tile) {
        multiply(c, a, memory.weights[tile * 32 + lane]);
    };
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
            start(c[j], memory.bias + 8 * j);
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
            start(r, memory.bias + 64 + 8 * j);
#pragma unroll
            for (int k = 0; k < 4; ++k) product(r, a[k], 16 + 4 * j + k);
            put(16 * m + group, j, r);
        }
    }
    __syncwarp();  // the next rows overwrite these
};

//# share_density
__shared__ Shared memory;
for (int i = threadIdx.x; i < 24 * 32; i += blockDim.x)
    memory.weights[i] = reinterpret_cast<const uint2*>(fragments.data)[i];
for (int i = threadIdx.x; i < 80; i += blockDim.x) memory.bias[i] = biases.data[i];
for (int i = 0; i < ROW; ++i) memory.rows[threadIdx.x][i] = 0u;
__syncthreads();
return reinterpret_cast<wp::uint64>(&memory);

//# put_features
uint2 bits;
asm("{.reg .f16 a, b; cvt.rn.f16.f32 a, %1; cvt.rn.f16.f32 b, %2; mov.b32 %0, {a, b};}"
    : "=r"(bits.x) : "f"(f[0]), "f"(f[1]));
asm("{.reg .f16 a, b; cvt.rn.f16.f32 a, %1; cvt.rn.f16.f32 b, %2; mov.b32 %0, {a, b};}"
    : "=r"(bits.y) : "f"(f[2]), "f"(f[3]));
*reinterpret_cast<uint2*>(&memory_at(shared).rows[threadIdx.x][2 * level]) = bits;

//# density_of_rows
find_density(memory_at(shared), [&](int row, int j, const Result& r) {
    row += n - lane;
    uint* const to = reinterpret_cast<uint*>(h.data) + size_t(row) * 8 + 4 * j + pair / 2;
    to[0] = halves(finite(r[0]), finite(r[1]));
    to[64] = halves(finite(r[2]), finite(r[3]));
    if (j == 0 && pair == 0) {
        sigma.data[row] = sigma_of(r[0]);
        sigma.data[row + 8] = sigma_of(r[2]);
    }
});

//# density_in_shared
uint* const mine = memory_at(shared).rows[threadIdx.x - lane];
find_density(memory_at(shared), [&](int row, int j, const Result& r) {
    uint* const to = mine + ROW * row + 4 * j + pair / 2;
    to[0] = halves(finite(r[0]), finite(r[1]));
    to[ROW * 8] = halves(finite(r[2]), finite(r[3]));
    if (j == 0 && pair == 0) {
        mine[ROW * row + SIGMA] = __float_as_uint(sigma_of(r[0]));
        mine[ROW * (row + 8) + SIGMA] = __float_as_uint(sigma_of(r[2]));
    }
});

//# sigma_in_shared
return __uint_as_float(memory_at(shared).rows[threadIdx.x][SIGMA]);

//# h_in_shared
const uint2 bits = *reinterpret_cast<const uint2*>(&memory_at(shared).rows[threadIdx.x][2 * k]);
float a, b, c, d;
asm("{.reg .f16 x, y; mov.b32 {x, y}, %2; cvt.f32.f16 %0, x; cvt.f32.f16 %1, y;}"
    : "=f"(a), "=f"(b) : "r"(bits.x));
asm("{.reg .f16 x, y; mov.b32 {x, y}, %2; cvt.f32.f16 %0, x; cvt.f32.f16 %1, y;}"
    : "=f"(c), "=f"(d) : "r"(bits.y));
return wp::vec_t<4, wp::float32>(a, b, c, d);
