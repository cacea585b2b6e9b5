"""The Triton kernels of triton.py, which describes what they compute and how precisely.

Triton compiles them for each number of FEATURES = L·F.  Names begin with

    w   weights                                     s   gradients of w, summed over samples
    p   the place where a layer's numbers begin     t   gradients of biases, likewise
    g_  gradients of the loss

tl.dot does not accept every size, so zeros pad matrices with 24 features or 3 colors.

Shapes: N samples, B of them in a block.  Weights are [out, in].
"""

import triton
import triton.language as tl

from ...definition import networks
from . import basis, shapes

WIDTH = tl.constexpr(shapes.WIDTH)  # of every hidden layer
GEOMETRY = tl.constexpr(networks.GEOMETRY_FEATURES)
BASIS = tl.constexpr(basis.BASIS_COUNT)
MAX_LOG_SIGMA = tl.constexpr(networks.MAX_LOG_SIGMA)
DOT_SIZE = tl.constexpr(16)  # tl.dot's operands have no shorter side
GRADIENT_PEAK = tl.constexpr(16.0)  # the largest gradient of a block where a network ends
MAX_HALF = tl.constexpr(65504.0)


@triton.jit
def _tile(ROWS: tl.constexpr, COLUMNS: tl.constexpr, STRIDE: tl.constexpr):
    """Addresses of a matrix, padded to tl.dot's sizes, and the mask of its entries."""
    i = tl.arange(0, triton.next_power_of_2(max(ROWS, DOT_SIZE)))[:, None]
    j = tl.arange(0, triton.next_power_of_2(max(COLUMNS, DOT_SIZE)))[None, :]
    return i * STRIDE + j, (i < ROWS) & (j < COLUMNS)


@triton.jit
def _weights(start, ROWS: tl.constexpr, COLUMNS: tl.constexpr, STRIDE: tl.constexpr):
    """Weights [out, in], or some of their columns."""
    where, inside = _tile(ROWS, COLUMNS, STRIDE)
    return tl.load(start + where, mask=inside, other=0.0).to(tl.float16)


@triton.jit
def _bias(start, ROWS: tl.constexpr):
    i = tl.arange(0, triton.next_power_of_2(max(ROWS, DOT_SIZE)))
    return tl.load(start + i, mask=i < ROWS, other=0.0).to(tl.float32)


@triton.jit
def _starts(parameters, FEATURES: tl.constexpr):
    """Start addresses of the layers a, h, c1, c2, rgb; see `pack`."""
    h = parameters + (FEATURES + 1) * WIDTH
    c1 = h + (WIDTH + 1) * GEOMETRY
    c2 = c1 + (GEOMETRY + BASIS + 1) * WIDTH
    return parameters, h, c1, c2, c2 + (WIDTH + 1) * WIDTH


@triton.jit
def _load_density(parameters, FEATURES: tl.constexpr):
    """The density network's weights."""
    a, h, _, _, _ = _starts(parameters, FEATURES)
    return _weights(a, WIDTH, FEATURES, FEATURES), _weights(h, GEOMETRY, WIDTH, WIDTH)


@triton.jit
def _load_weights(parameters, FEATURES: tl.constexpr):
    """Weights, one layer after another; c1's in two pieces, for h and y."""
    _, _, c1, c2, rgb = _starts(parameters, FEATURES)
    wa, wh = _load_density(parameters, FEATURES)
    wc1h = _weights(c1, WIDTH, GEOMETRY, GEOMETRY + BASIS)
    wc1y = _weights(c1 + GEOMETRY, WIDTH, BASIS, GEOMETRY + BASIS)
    wc2 = _weights(c2, WIDTH, WIDTH, WIDTH)
    return wa, wh, wc1h, wc1y, wc2, _weights(rgb, 3, WIDTH, WIDTH)


@triton.jit
def _load_rows(array, rows, count, COLUMNS: tl.constexpr):
    """Rows of [N, columns], padded with zeros; rows from `count` on are zero."""
    j = tl.arange(0, triton.next_power_of_2(max(COLUMNS, DOT_SIZE)))[None, :]
    inside = (rows[:, None] < count) & (j < COLUMNS)
    return tl.load(array + rows[:, None] * COLUMNS + j, mask=inside, other=0.0)


@triton.jit
def _store_rows(array, rows, count, values, COLUMNS: tl.constexpr):
    j = tl.arange(0, triton.next_power_of_2(max(COLUMNS, DOT_SIZE)))[None, :]
    inside = (rows[:, None] < count) & (j < COLUMNS)
    tl.store(array + rows[:, None] * COLUMNS + j, values, mask=inside)


@triton.jit
def _hidden(x, w, bias):
    """relu(W x + b) for a block.  x [B, in], w [64, in]"""
    y = tl.dot(x, tl.trans(w)) + _bias(bias, WIDTH)[None, :]
    return tl.maximum(y, 0.0).to(tl.float16)


@triton.jit
def _density(x, start, wa, wh, FEATURES: tl.constexpr):
    """a and h."""
    pa, ph, _, _, _ = _starts(start, FEATURES)
    a = _hidden(x, wa, pa + WIDTH * FEATURES)
    return a, tl.dot(a, tl.trans(wh)) + _bias(ph + GEOMETRY * WIDTH, GEOMETRY)[None, :]


@triton.jit
def _color(h, y, start, wc1h, wc1y, wc2, wrgb, FEATURES: tl.constexpr):
    """c1, c2 and rgb, the last padded to 16 columns."""
    _, _, p1, p2, p3 = _starts(start, FEATURES)
    c1 = tl.dot(y, tl.trans(wc1y), acc=tl.dot(h, tl.trans(wc1h)))
    c1 += _bias(p1 + (GEOMETRY + BASIS) * WIDTH, WIDTH)[None, :]
    c1 = tl.maximum(c1, 0.0).to(tl.float16)
    c2 = _hidden(c1, wc2, p2 + WIDTH * WIDTH)
    return c1, c2, tl.sigmoid(tl.dot(c2, tl.trans(wrgb)) + _bias(p3 + 3 * WIDTH, 3)[None, :])


@triton.jit
def _sigma(h):
    """[B, 16] -> [B]"""
    j = tl.arange(0, GEOMETRY)[None, :]
    return tl.exp(tl.minimum(tl.sum(tl.where(j == 0, h, 0.0), axis=1), MAX_LOG_SIGMA))


@triton.jit(do_not_specialize=["capacity"])
def forward_kernel(
    features,  # [N, FEATURES]
    basis,  # [N, 16]
    parameters,  # see `pack`
    sample_count,  # [1]
    sigma,  # [N] out
    rgb,  # [N, 3] out
    capacity,  # N
    FEATURES: tl.constexpr,
    BLOCK: tl.constexpr,
):
    count = tl.minimum(tl.load(sample_count), capacity)
    wa, wh, wc1h, wc1y, wc2, wrgb = _load_weights(parameters, FEATURES)
    for block in range(tl.program_id(0), tl.cdiv(count, BLOCK), tl.num_programs(0)):
        n = block * BLOCK + tl.arange(0, BLOCK)
        x = _load_rows(features, n, count, FEATURES).to(tl.float16)
        y = _load_rows(basis, n, count, BASIS).to(tl.float16)
        _, h = _density(x, parameters, wa, wh, FEATURES)
        tl.store(sigma + n, _sigma(h), mask=n < count)
        _, _, color = _color(h.to(tl.float16), y, parameters, wc1h, wc1y, wc2, wrgb, FEATURES)
        _store_rows(rgb, n, count, color, 3)


@triton.jit(do_not_specialize=["capacity"])
def density_kernel(
    features,  # [N, FEATURES]
    parameters,  # those of the density network, see `pack`
    sample_count,  # [1]
    sigma,  # [N] out
    h,  # [N, 16] out
    capacity,  # N
    FEATURES: tl.constexpr,
    BLOCK: tl.constexpr,
):
    count = tl.minimum(tl.load(sample_count), capacity)
    wa, wh = _load_density(parameters, FEATURES)
    for block in range(tl.program_id(0), tl.cdiv(count, BLOCK), tl.num_programs(0)):
        n = block * BLOCK + tl.arange(0, BLOCK)
        x = _load_rows(features, n, count, FEATURES).to(tl.float16)
        _, out = _density(x, parameters, wa, wh, FEATURES)
        tl.store(sigma + n, _sigma(out), mask=n < count)
        _store_rows(h, n, count, out, GEOMETRY)


@triton.jit
def _unit(g):
    """The divisor of a block's gradients that makes them fit float16."""
    return tl.maximum(tl.max(tl.abs(g)), 1e-30) / GRADIENT_PEAK


@triton.jit
def _half(g):
    """float16, saturated; NaN stays NaN, so that a caller's mistake can be seen."""
    return tl.clamp(g, -MAX_HALF, MAX_HALF, propagate_nan=tl.PropagateNan.ALL).to(tl.float16)


@triton.jit
def _before(g, a):
    """The gradient by a hidden layer's sum, from the gradient by its output a."""
    return _half(tl.where(a > 0.0, g, 0.0))


@triton.jit
def _add(total, g, x, unit):
    """The sum [out, in] so far, and a block's gᵀ x.  g [B, out] in `unit`s, x [B, in]"""
    return total + tl.dot(tl.trans(g), x) * unit


@triton.jit
def _zeros(ROWS: tl.constexpr, COLUMNS: tl.constexpr):
    return tl.zeros(
        (
            triton.next_power_of_2(max(ROWS, DOT_SIZE)),
            triton.next_power_of_2(max(COLUMNS, DOT_SIZE)),
        ),
        tl.float32,
    )


@triton.jit
def _store(start, values, ROWS: tl.constexpr, COLUMNS: tl.constexpr, STRIDE: tl.constexpr):
    where, inside = _tile(ROWS, COLUMNS, STRIDE)
    tl.store(start + where, values, mask=inside)


@triton.jit
def _store_layer(start, weights, bias, ROWS: tl.constexpr, COLUMNS: tl.constexpr):
    """`bias` has equal columns."""
    _store(start, weights, ROWS, COLUMNS, COLUMNS)
    _store(start + ROWS * COLUMNS, bias, ROWS, 1, 1)


@triton.jit
def _store_out(start, weights, bias, ROWS: tl.constexpr):
    """A network's last layer.  weights [in, out], bias [B, out]"""
    i = tl.arange(0, DOT_SIZE)
    j = tl.arange(0, WIDTH)
    tl.store(start + i[None, :] * WIDTH + j[:, None], weights, mask=i[None, :] < ROWS)
    tl.store(start + ROWS * WIDTH + i, tl.sum(bias, axis=0), mask=i < ROWS)


@triton.jit
def _add_density(sa, ta, sh, th, g_h, a, x, ones, wa, wh):
    """The sums of the density network with a block's gradients of h added; gradients of x."""
    th += g_h
    unit = _unit(g_h)
    g_h = _half(g_h * (1.0 / unit))
    sh = _add(sh, a, g_h, unit)
    g_a = _before(tl.dot(g_h, wh), a)
    sa, ta = _add(sa, g_a, x, unit), _add(ta, g_a, ones, unit)
    return sa, ta, sh, th, tl.dot(g_a, wa) * unit


@triton.jit(do_not_specialize=["capacity"])
def backward_kernel(
    features,  # [N, FEATURES]
    basis,  # [N, 16]
    parameters,  # [PARAMETERS], see `pack`
    sample_count,  # [1]
    g_sigma,  # [N]
    g_rgb,  # [N, 3]
    g_features,  # [N, FEATURES] out
    partial,  # [programs, PARAMETERS] out: gradients of the program's samples
    capacity,  # N
    FEATURES: tl.constexpr,
    PARAMETERS: tl.constexpr,
    BLOCK: tl.constexpr,
):
    count = tl.minimum(tl.load(sample_count), capacity)
    wa, wh, wc1h, wc1y, wc2, wrgb = _load_weights(parameters, FEATURES)
    # Sums over samples: gradients of weights [out, in], and of biases as if they were weights
    # of ones.  h and rgb have too few rows for that (every warp would do the same work): their
    # sums are [in, out], and those of their biases a block of rows, added up at the end.
    ones = tl.full((BLOCK, DOT_SIZE), 1.0, tl.float16)
    sa, ta = _zeros(WIDTH, FEATURES), _zeros(WIDTH, 1)
    sh, th = _zeros(WIDTH, GEOMETRY), _zeros(BLOCK, GEOMETRY)
    sc1h, sc1y, tc1 = _zeros(WIDTH, GEOMETRY), _zeros(WIDTH, BASIS), _zeros(WIDTH, 1)
    sc2, tc2 = _zeros(WIDTH, WIDTH), _zeros(WIDTH, 1)
    srgb, trgb = _zeros(WIDTH, 3), _zeros(BLOCK, 3)
    for block in range(tl.program_id(0), tl.cdiv(count, BLOCK), tl.num_programs(0)):
        n = block * BLOCK + tl.arange(0, BLOCK)
        x = _load_rows(features, n, count, FEATURES).to(tl.float16)
        y = _load_rows(basis, n, count, BASIS).to(tl.float16)
        a, h = _density(x, parameters, wa, wh, FEATURES)
        h_half = h.to(tl.float16)
        c1, c2, color = _color(h_half, y, parameters, wc1h, wc1y, wc2, wrgb, FEATURES)

        g_sum = _load_rows(g_rgb, n, count, 3) * color * (1.0 - color)
        trgb += g_sum
        unit = _unit(g_sum)
        g_sum = _half(g_sum * (1.0 / unit))
        srgb = _add(srgb, c2, g_sum, unit)
        g_c2 = _before(tl.dot(g_sum, wrgb), c2)
        sc2, tc2 = _add(sc2, g_c2, c1, unit), _add(tc2, g_c2, ones, unit)
        g_c1 = _before(tl.dot(g_c2, wc2), c1)
        sc1h, sc1y = _add(sc1h, g_c1, h_half, unit), _add(sc1y, g_c1, y, unit)
        tc1 = _add(tc1, g_c1, ones, unit)

        g_h0 = tl.load(g_sigma + n, mask=n < count, other=0.0) * _sigma(h)
        first = tl.arange(0, GEOMETRY)[None, :] == 0
        g_h = tl.dot(g_c1, wc1h) * unit + tl.where(first, g_h0[:, None], 0.0)
        sa, ta, sh, th, g_x = _add_density(sa, ta, sh, th, g_h, a, x, ones, wa, wh)
        _store_rows(g_features, n, count, g_x, FEATURES)

    pa, ph, pc1, pc2, prgb = _starts(partial + tl.program_id(0) * PARAMETERS, FEATURES)
    _store_layer(pa, sa, ta, WIDTH, FEATURES)
    _store_out(ph, sh, th, GEOMETRY)
    _store(pc1, sc1h, WIDTH, GEOMETRY, GEOMETRY + BASIS)
    _store(pc1 + GEOMETRY, sc1y, WIDTH, BASIS, GEOMETRY + BASIS)
    _store(pc1 + (GEOMETRY + BASIS) * WIDTH, tc1, WIDTH, 1, 1)
    _store_layer(pc2, sc2, tc2, WIDTH, WIDTH)
    _store_out(prgb, srgb, trgb, 3)


@triton.jit(do_not_specialize=["capacity"])
def density_backward_kernel(
    features,  # [N, FEATURES]
    parameters,  # [PARAMETERS], those of the density network, see `pack`
    sample_count,  # [1]
    g_sigma,  # [N]
    g_out,  # [N, 16]: gradients of h, without what comes by sigma
    g_features,  # [N, FEATURES] out
    partial,  # [programs, PARAMETERS] out: gradients of the program's samples
    capacity,  # N
    FEATURES: tl.constexpr,
    PARAMETERS: tl.constexpr,
    BLOCK: tl.constexpr,
):
    count = tl.minimum(tl.load(sample_count), capacity)
    wa, wh = _load_density(parameters, FEATURES)
    ones = tl.full((BLOCK, DOT_SIZE), 1.0, tl.float16)  # sums as in backward_kernel
    sa, ta = _zeros(WIDTH, FEATURES), _zeros(WIDTH, 1)
    sh, th = _zeros(WIDTH, GEOMETRY), _zeros(BLOCK, GEOMETRY)
    for block in range(tl.program_id(0), tl.cdiv(count, BLOCK), tl.num_programs(0)):
        n = block * BLOCK + tl.arange(0, BLOCK)
        x = _load_rows(features, n, count, FEATURES).to(tl.float16)
        a, h = _density(x, parameters, wa, wh, FEATURES)
        g_h0 = tl.load(g_sigma + n, mask=n < count, other=0.0) * _sigma(h)
        first = tl.arange(0, GEOMETRY)[None, :] == 0
        g_h = _load_rows(g_out, n, count, GEOMETRY) + tl.where(first, g_h0[:, None], 0.0)
        sa, ta, sh, th, g_x = _add_density(sa, ta, sh, th, g_h, a, x, ones, wa, wh)
        _store_rows(g_features, n, count, g_x, FEATURES)

    pa, ph, _, _, _ = _starts(partial + tl.program_id(0) * PARAMETERS, FEATURES)
    _store_layer(pa, sa, ta, WIDTH, FEATURES)
    _store_out(ph, sh, th, GEOMETRY)
