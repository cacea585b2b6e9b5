"""The networks on a GPU's tensor cores, in Warp kernels, so that rendering needs no torch.

If samples have colors, one kernel evaluates both networks.  They must have the usual shape: one
hidden layer of 64 for density, two for color, up to 8 levels.  If each ray has one color, one
kernel evaluates the density network for samples (`geometry_kernel`, or density_rows.py within
another kernel), and another (colors.cu) the color network for rays; hidden layers of that network
may have one of several widths.

A warp multiplies by mma.sync.m16n8k16, and takes 32 samples through all layers in its registers:
after one product is rounded to half precision, each thread has in its registers the numbers that
the next product takes as its operand.  `fragments` stores the weights in the order in which the
threads of a warp read them.

Weights, inputs and hidden layers are float16; sums, biases and outputs are float32 (as in
triton.py), but h is float16 between the networks.  The kernels need compute capability 8.0 or
newer.

Shapes: N samples, R rays, L levels.
"""

from pathlib import Path

import numpy as np
import warp as wp

from ...base.native import native_source
from ...base.wide import vec4h
from ...definition.networks import MAX_LOG_SIGMA
from .shapes import MAX_FEATURES, has_usual_density, has_usual_shape

TILE_K, TILE_N = 16, 8  # of one product
OLDEST_GPU = 80  # Warp's arch
BLOCK_SIZE = 128
BLOCKS_PER_PROCESSOR = 3  # more would not fit into the registers
DENSITY_BLOCKS_PER_PROCESSOR = 5  # for the density network alone
COLOR_BLOCKS_PER_PROCESSOR = 2  # for the colors of rays
AHEAD = 2  # steps of a product whose weights are on the way, for the colors of rays
COLOR_WIDTHS = (32, 64, 128, 192, 256)  # that hidden layers of rays' colors are filled up to

# Warp compiles a module for each block size: loading one ahead has to know it.
wp.set_module_options({"enable_backward": False, "block_dim": BLOCK_SIZE})


def fits(field, device) -> bool:
    """Whether TensorCoreNetworks can evaluate this field's networks on a Warp device."""
    if not device.is_cuda or device.arch < OLDEST_GPU:
        return False
    density, color = (
        [weights.shape for weights, _ in layers]
        for layers in (field.density_layers, field.color_layers)
    )
    if not field.options.deferred:
        return has_usual_shape([*density, *color])
    widths = [width for _, width in color[:-1]]
    return has_usual_density(density) and max(widths, default=0) <= max(COLOR_WIDTHS)


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
    """The networks of a field on a CUDA device, for images: without allocations or waits.

    Attributes:
        density: `fragments` and biases of the density network, where rays have colors.
    """

    def __init__(self, field, device):
        density, color = field.density_layers, field.color_layers
        (first, bias), *others = density
        density = [(np.pad(first, ((0, MAX_FEATURES - len(first)), (0, 0))), bias), *others]
        self.device = device
        self._no_slots = [wp.empty(0, dtype=int, device=device)] * 2
        if field.options.deferred:
            color = widened(color)
            self.density, self._color = (self._weights(layers) for layers in (density, color))
            self._layers = wp.array(layer_places(color), dtype=int, device=device)
        else:
            self._both = self._weights([*density, *color])

    def evaluate(self, features, basis, total, sigma, rgb, slots=None):
        """Fill sigma and rgb by `networks_kernel`.

        `slots`: counts and stride, where rows are slots of rays; free ones may get no values.
        """
        inputs = [features, basis, *self._both, total, *self._slots(slots)]
        inputs.append(_columns(features, sigma))
        self._launch(networks_kernel, inputs, [sigma, rgb])

    def geometry(self, features, total, sigma, h, slots=None):
        """Fill sigma and h by `geometry_kernel`; `slots` as for `evaluate`."""
        inputs = [features, *self.density, total, *self._slots(slots)]
        inputs.append(_columns(features, sigma))
        self._launch(geometry_kernel, inputs, [sigma, h], DENSITY_BLOCKS_PER_PROCESSOR)

    def colors(self, x, count, rgb):
        """Fill rgb of the first rays by `colors_kernel`; `count` [1] is on the device."""
        inputs = [x, *self._color, self._layers, count]
        self._launch(colors_kernel, inputs, [rgb], COLOR_BLOCKS_PER_PROCESSOR)

    def _slots(self, slots):
        return self._no_slots if slots is None else slots

    def _weights(self, layers):
        """`fragments` of all weights, and all biases with whole tiles."""
        tiles = np.concatenate([fragments(weights) for weights, _ in layers]).reshape(-1, 4)
        biases = np.concatenate([np.pad(bias, (0, -len(bias) % TILE_N)) for _, bias in layers])
        biases = wp.array(biases.astype(np.float32), device=self.device)
        return wp.array(tiles, dtype=vec4h, device=self.device), biases

    def _launch(self, kernel, inputs, outputs, blocks=BLOCKS_PER_PROCESSOR):
        where = {"device": self.device, "block_dim": BLOCK_SIZE}
        threads = self.device.sm_count * blocks * BLOCK_SIZE
        wp.launch(kernel, dim=threads, inputs=inputs, outputs=outputs, **where)


def _columns(features, sigma) -> int:
    return 4 * (len(features) // max(len(sigma), 1))


def widened(layers):
    """Layers with hidden units of zeros, as many as make their widths COLOR_WIDTHS."""
    wide, missing_rows = [], 0
    for number, (weights, bias) in enumerate(layers):
        columns = weights.shape[1]
        missing = 0
        if number < len(layers) - 1:
            missing = min(width for width in COLOR_WIDTHS if width >= columns) - columns
        weights = np.pad(weights, ((0, missing_rows), (0, missing)))
        wide.append((weights, np.pad(bias, (0, missing))))
        missing_rows = missing
    return wide


def layer_places(layers):
    """Of each layer: tiles of its rows and of its columns, its first tile, its first bias."""
    places, tile, bias = [], 0, 0
    for weights, _ in layers:
        rows, columns = (-(-n // m) for n, m in zip(weights.shape, (TILE_K, TILE_N), strict=True))
        places.append((rows, columns, tile, bias))
        tile, bias = tile + rows * columns, bias + columns * TILE_N
    return np.array(places, np.int32)


def tensor_core_body(name: str, section="", otherwise="", **values) -> str:
    """The body of a native function: what a file has for GPUs with tensor cores, or `otherwise`.

    Args:
        section, values: See `native_source`; MAX_LOG_SIGMA is there.
    """
    folder = Path(__file__).parent
    values |= {"MAX_LOG_SIGMA": f"{MAX_LOG_SIGMA}f"}
    source = native_source(folder / name, [folder / "tensor_cores.h"], values, section)
    condition = f"#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= {10 * OLDEST_GPU}\n"
    return f"{condition}{source}#else\n{otherwise}\n#endif\n"


@wp.func_native(tensor_core_body("mma.cu", "evaluate_native", TILES=76, BIASES=216))
def evaluate_native(
    features: wp.array(dtype=vec4h),
    basis: wp.array(dtype=vec4h),
    fragments: wp.array(dtype=vec4h),
    biases: wp.array(dtype=float),
    total: wp.array(dtype=int),
    counts: wp.array(dtype=int),
    stride: wp.array(dtype=int),
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
    counts: wp.array(dtype=int),  # [rays] samples of each ray in its slots; empty: rows are packed
    stride: wp.array(dtype=int),  # [1] slot k of ray i is row k · stride + i
    columns: int,  # 4 L
    sigma: wp.array(dtype=float),  # [N] out
    rgb: wp.array(dtype=wp.vec3),  # [N] out
):
    evaluate_native(features, basis, weights, biases, total, counts, stride, columns, sigma, rgb)


@wp.func_native(tensor_core_body("mma.cu", "geometry_native", TILES=24, BIASES=80))
def geometry_native(
    features: wp.array(dtype=vec4h),
    fragments: wp.array(dtype=vec4h),
    biases: wp.array(dtype=float),
    total: wp.array(dtype=int),
    counts: wp.array(dtype=int),
    stride: wp.array(dtype=int),
    columns: int,
    sigma: wp.array(dtype=float),
    h: wp.array(dtype=vec4h),
): ...


@wp.kernel
def geometry_kernel(
    features: wp.array(dtype=vec4h),  # [N · L] one sample after another
    weights: wp.array(dtype=vec4h),  # `fragments` of the density network
    biases: wp.array(dtype=float),
    total: wp.array(dtype=int),  # [1] existing samples, at most N
    counts: wp.array(dtype=int),  # [rays] samples of each ray in its slots; empty: rows are packed
    stride: wp.array(dtype=int),  # [1] slot k of ray i is row k · stride + i
    columns: int,  # 4 L
    sigma: wp.array(dtype=float),  # [N] out
    h: wp.array(dtype=vec4h),  # [4 N] out
):
    geometry_native(features, weights, biases, total, counts, stride, columns, sigma, h)


@wp.func_native(tensor_core_body("colors.cu", MAX_WIDTH=max(COLOR_WIDTHS), AHEAD=AHEAD))
def colors_native(
    x: wp.array(dtype=vec4h),
    fragments: wp.array(dtype=vec4h),
    biases: wp.array(dtype=float),
    layers: wp.array2d(dtype=int),
    count: wp.array(dtype=int),
    rgb: wp.array(dtype=wp.vec3),
): ...


@wp.kernel
def colors_kernel(
    x: wp.array(dtype=vec4h),  # [8 R] mean h and Y of the mean direction, ray after ray
    weights: wp.array(dtype=vec4h),  # `fragments` of the color network
    biases: wp.array(dtype=float),
    layers: wp.array2d(dtype=int),  # `layer_places`
    count: wp.array(dtype=int),  # [1] rays, at most R
    rgb: wp.array(dtype=wp.vec3),  # [R] out
):
    colors_native(x, weights, biases, layers, count, rgb)
