"""Both networks on a GPU's tensor cores, in one Warp kernel: rendering needs no torch.

The kernel takes networks of the usual shape: one hidden layer of 64 for density, two for
color, up to 8 levels.  A warp takes 32 samples through all layers in its registers by
mma.sync.m16n8k16: the result of one product, rounded to half precision, lies in each thread's
registers where the next product expects its operand.  The weights lie in shared memory in the
order in which the threads of a warp read them (`fragments`).

Weights, inputs and hidden layers are float16; sums, biases and outputs are float32 (as in
triton.py).  The kernel needs compute capability 8.0 or newer.

Shapes: N samples, L levels.
"""

import numpy as np
import warp as wp

from ...wide import vec4h
from .reference import MAX_FEATURES, MAX_LOG_SIGMA, WIDTH, has_usual_shape

TILE_K, TILE_N = 16, 8  # of one product
OLDEST_GPU = 80  # Warp's arch
BLOCK_SIZE = 128
BLOCKS_PER_PROCESSOR = 3  # the registers have room for no more

# Warp compiles a module for each block size: loading one ahead has to know it.
wp.set_module_options({"enable_backward": False, "block_dim": BLOCK_SIZE})


def fits(field, device) -> bool:
    """Whether TensorCoreNetworks can evaluate this field's networks on a Warp device."""
    shapes = [weights.shape for weights, _ in (*field.density_layers, *field.color_layers)]
    return device.is_cuda and device.arch >= OLDEST_GPU and has_usual_shape(shapes)


def fragments(weights):
    """A layer's weights [in, out], padded with zeros, in the order in which threads read them.

    The tiles are [out / 8, in / 16].  In tile (n, k) thread `lane` holds column 8 n + lane / 4
    of the rows 16 k + p + (0, 1, 8, 9) with p = 2 (lane % 4).

    Returns:
        [tiles, 32, 4] float16
    """
    rows, columns = (-(-n // m) for n, m in zip(weights.shape, (TILE_K, TILE_N), strict=True))
    padded = np.zeros((rows * TILE_K, columns * TILE_N), np.float16)
    padded[: weights.shape[0], : weights.shape[1]] = weights
    lane = np.arange(32)
    row = 2 * (lane % 4)[:, None] + np.array([0, 1, 8, 9])  # [32, 4]
    column = np.broadcast_to((lane // 4)[:, None], row.shape)
    tiles = padded.reshape(rows, TILE_K, columns, TILE_N).transpose(2, 0, 1, 3)
    return tiles[:, :, row, column].reshape(-1, 32, 4)


class TensorCoreNetworks:
    """The networks of a field on a CUDA device, for images."""

    def __init__(self, field, device):
        layers = [*field.density_layers, *field.color_layers]
        first = np.zeros((MAX_FEATURES, WIDTH), np.float32)
        first[: len(layers[0][0])] = layers[0][0]
        weights = [first, *(w for w, _ in layers[1:])]
        biases = [b for _, b in layers]
        self.device = device
        self._fragments = wp.array(
            np.concatenate([fragments(w) for w in weights]).reshape(-1, 4),
            dtype=vec4h,
            device=device,
        )
        biases = np.concatenate([*biases, np.zeros(TILE_N - 3)])
        self._biases = wp.array(biases.astype(np.float32), device=device)
        self._threads = device.sm_count * BLOCKS_PER_PROCESSOR * BLOCK_SIZE

    def evaluate(self, features, basis, total, sigma, rgb):
        """Fill sigma and rgb by `networks_kernel`, without an allocation or a wait of the host."""
        columns = 4 * (len(features) // max(len(sigma), 1))
        wp.launch(
            networks_kernel,
            dim=self._threads,
            inputs=[features, basis, self._fragments, self._biases, total, columns],
            outputs=[sigma, rgb],
            device=self.device,
            block_dim=BLOCK_SIZE,
        )


@wp.func_native(
    """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    using uint = unsigned int;
    using Operand = uint[4];  // Warp has macros named float and int: no brackets behind them
    using Result = float[4];
    constexpr int TILES = 76, BIASES = 216;  // of all layers, one after another
    __shared__ uint2 weights[TILES * 32];
    __shared__ float bias[BIASES];
    for (int i = threadIdx.x; i < TILES * 32; i += blockDim.x)
        weights[i] = reinterpret_cast<const uint2*>(fragments.data)[i];
    for (int i = threadIdx.x; i < BIASES; i += blockDim.x) bias[i] = biases.data[i];
    __syncthreads();

    const int lane = threadIdx.x & 31, group = lane >> 2, pair = 2 * (lane & 3);
    const int count = total.data[0];
    const int warp_count = gridDim.x * (blockDim.x >> 5);
    const char* x_bytes = reinterpret_cast<const char*>(features.data);
    const char* y_bytes = reinterpret_cast<const char*>(basis.data);

    auto multiply = [&](Result& c, const Operand& a, int tile) {
        const uint2 b = weights[tile * 32 + lane];
        asm("mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 "
            "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
            : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
            : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b.x), "r"(b.y));
    };
    auto halves = [](float low, float high) {
        uint bits;
        asm("cvt.rn.f16x2.f32 %0, %1, %2;" : "=r"(bits) : "f"(high), "f"(low));
        return bits;
    };
    auto relu = [](float v) { return v > 0.0f ? v : 0.0f; };
    auto start = [&](Result& c, int first) {
        c[0] = c[2] = bias[first + pair];
        c[1] = c[3] = bias[first + pair + 1];
    };
    // The results of two products side by side are one operand of the next layer.
    auto join = [&](Operand& a, const Result& c, const Result& d) {
        a[0] = halves(c[0], c[1]);
        a[1] = halves(c[2], c[3]);
        a[2] = halves(d[0], d[1]);
        a[3] = halves(d[2], d[3]);
    };
    auto load = [&](Operand& a, const char* bytes, int row, int columns_, int column) {
        for (int i = 0; i < 4; ++i) {
            const int r = row + (i & 1) * 8, c = column + pair + (i >> 1) * 8;
            a[i] = r < count && c < columns_
                ? *reinterpret_cast<const uint*>(bytes + 2 * (size_t(r) * columns_ + c)) : 0u;
        }
    };

    for (int tile = blockIdx.x * (blockDim.x >> 5) + (threadIdx.x >> 5); tile * 32 < count;
         tile += warp_count) {
        uint a[2][4][4];
        float c[2][8][4];
        const int first_row = tile * 32 + group;
        for (int m = 0; m < 2; ++m) {
            load(a[m][0], x_bytes, first_row + 16 * m, columns, 0);
            load(a[m][1], x_bytes, first_row + 16 * m, columns, 16);
        }
#pragma unroll
        for (int n = 0; n < 8; ++n)
#pragma unroll
            for (int m = 0; m < 2; ++m) {
                start(c[m][n], 8 * n);
                multiply(c[m][n], a[m][0], 2 * n);
                multiply(c[m][n], a[m][1], 2 * n + 1);
                for (int i = 0; i < 4; ++i) c[m][n][i] = relu(c[m][n][i]);
            }
        uint hy[2][2][4];
#pragma unroll
        for (int m = 0; m < 2; ++m) {
            for (int k = 0; k < 4; ++k) join(a[m][k], c[m][2 * k], c[m][2 * k + 1]);
            float h[2][4];
#pragma unroll
            for (int n = 0; n < 2; ++n) {
                start(h[n], 64 + 8 * n);
                for (int k = 0; k < 4; ++k) multiply(h[n], a[m][k], 16 + 4 * n + k);
            }
            const int row = first_row + 16 * m;
            if (pair == 0) {
                if (row < count) sigma.data[row] = expf(fminf(h[0][0], MAX_LOG_SIGMA));
                if (row + 8 < count) sigma.data[row + 8] = expf(fminf(h[0][2], MAX_LOG_SIGMA));
            }
            join(hy[m][0], h[0], h[1]);
            load(hy[m][1], y_bytes, row, 16, 0);
        }
#pragma unroll
        for (int n = 0; n < 8; ++n)
#pragma unroll
            for (int m = 0; m < 2; ++m) {
                start(c[m][n], 80 + 8 * n);
                multiply(c[m][n], hy[m][0], 24 + 2 * n);
                multiply(c[m][n], hy[m][1], 24 + 2 * n + 1);
                for (int i = 0; i < 4; ++i) c[m][n][i] = relu(c[m][n][i]);
            }
#pragma unroll
        for (int m = 0; m < 2; ++m)
            for (int k = 0; k < 4; ++k) join(a[m][k], c[m][2 * k], c[m][2 * k + 1]);
#pragma unroll
        for (int n = 0; n < 8; ++n)
#pragma unroll
            for (int m = 0; m < 2; ++m) {
                start(c[m][n], 144 + 8 * n);
                for (int k = 0; k < 4; ++k) multiply(c[m][n], a[m][k], 40 + 4 * n + k);
                for (int i = 0; i < 4; ++i) c[m][n][i] = relu(c[m][n][i]);
            }
#pragma unroll
        for (int m = 0; m < 2; ++m) {
            for (int k = 0; k < 4; ++k) join(a[m][k], c[m][2 * k], c[m][2 * k + 1]);
            float o[4];
            start(o, 208);
            for (int k = 0; k < 4; ++k) multiply(o, a[m][k], 72 + k);
            for (int i = 0; i < 4; ++i) {
                const int row = first_row + 16 * m + (i >> 1) * 8, channel = pair + (i & 1);
                if (row < count && channel < 3)
                    reinterpret_cast<float*>(rgb.data)[3 * row + channel]
                        = 1.0f / (1.0f + expf(-o[i]));
            }
        }
    }
#endif
""".replace("MAX_LOG_SIGMA", f"{MAX_LOG_SIGMA}f")
)
def evaluate_native(
    features: wp.array(dtype=vec4h),
    basis: wp.array(dtype=vec4h),
    fragments: wp.array(dtype=vec4h),
    biases: wp.array(dtype=float),
    total: wp.array(dtype=int),
    columns: int,
    sigma: wp.array(dtype=float),
    rgb: wp.array(dtype=wp.vec3),
): ...


@wp.kernel
def networks_kernel(
    features: wp.array(dtype=vec4h),  # [N · L] one sample after another
    basis: wp.array(dtype=vec4h),  # [4 N] spherical harmonics
    weights: wp.array(dtype=vec4h),  # `fragments` of all layers
    biases: wp.array(dtype=float),
    total: wp.array(dtype=int),  # [1] existing samples, at most N
    columns: int,  # 4 L
    sigma: wp.array(dtype=float),  # [N] out
    rgb: wp.array(dtype=wp.vec3),  # [N] out
):
    evaluate_native(features, basis, weights, biases, total, columns, sigma, rgb)
