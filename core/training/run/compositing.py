"""The volume-rendering sum of training rays and its gradients; formulas in render/rounds.

On CUDA the 32 lanes of a warp take 32 samples of a ray at a time, because a step waits for its
longest rays.  On the CPU one lane takes one sample after another.  The kernels are the same:
`sum_before`, `product_before` and `last_lane` combine the lanes' values.

A ray sums a vector of each sample: its color (`vec3`), or, if each ray has one color, h, the
density network's output (`geometry_vector`).

Shapes: R rays, N packed samples; ray r has the samples ends[r] - counts[r] .. ends[r] - 1.
"""

from typing import Any

import warp as wp

from ...field import GEOMETRY_FEATURES

LEAST_TRANSMITTANCE = wp.constant(1.0e-3)  # in front of a visible sample

geometry_vector = wp.types.vector(length=GEOMETRY_FEATURES, dtype=wp.float32)

wp.set_module_options({"enable_backward": False})


def lane_count(device) -> int:
    """Threads that a ray has on the device: launch kernels with as many times R."""
    return 32 if wp.get_device(device).is_cuda else 1


# `start` and the x of all lanes before this one, combined.
BEFORE = """
#if defined(__CUDA_ARCH__)
    float all = x;
    for (int distance = 1; distance < 32; distance *= 2) {
        float other = __shfl_up_sync(0xffffffffu, all, distance);
        if ((threadIdx.x & 31) >= distance) all = all OPERATOR other;
    }
    all = __shfl_up_sync(0xffffffffu, all, 1);
    return (threadIdx.x & 31) == 0 ? start : start OPERATOR all;
#else
    return start;
#endif
"""


@wp.func_native(BEFORE.replace("OPERATOR", "+"))
def sum_before(start: float, x: float) -> float: ...


@wp.func_native(BEFORE.replace("OPERATOR", "*"))
def product_before(start: float, x: float) -> float: ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __shfl_sync(0xffffffffu, x, 31);
#else
    return x;
#endif
""")
def last_lane(x: float) -> float:
    """The x of the last lane."""
    ...


@wp.func
def total(x: float) -> float:
    """The sum of all lanes."""
    return last_lane(sum_before(0.0, x) + x)


@wp.func
def total(x: wp.vec3):  # noqa: F811
    return wp.vec3(total(x[0]), total(x[1]), total(x[2]))


@wp.func
def total(x: geometry_vector):  # noqa: F811
    y = geometry_vector()
    for k in range(wp.static(GEOMETRY_FEATURES)):
        y[k] = total(x[k])
    return y


@wp.kernel
def composite_kernel(
    lanes: int,
    sigma: wp.array(dtype=float),  # [N]
    values: wp.array(dtype=Any),  # [N]
    length: wp.array(dtype=float),  # [N]
    t: wp.array(dtype=float),  # [N]
    counts: wp.array(dtype=int),  # [R]
    ends: wp.array(dtype=int),  # [R]
    weights: wp.array(dtype=float),  # [N] out
    sums: wp.array(dtype=Any),  # [R] out
    opacity: wp.array(dtype=float),  # [R] out
    weighted_t: wp.array(dtype=float),  # [R] out: Σ w t
    distortion: wp.array(dtype=float),  # [R] out
    lead: wp.array(dtype=float),  # [R] out
    visible: wp.array(dtype=int),  # [R] out: samples behind more than LEAST_TRANSMITTANCE
):
    """`weights`, `distortion` and `lead` of core/definition, sums, numbers of visible samples."""
    ray = wp.tid() // lanes
    lane = wp.tid() - ray * lanes
    end = ends[ray]
    first = end - counts[ray]
    transmittance = float(1.0)
    total_w = float(0.0)  # Σ w_j and Σ w_j t_j of the pieces so far
    total_t = float(0.0)
    c = values.dtype()  # sums of this lane's pieces
    loss = float(0.0)
    visible_count = float(0.0)  # of this lane's samples
    while first < end:
        n = first + lane
        remaining = float(1.0)
        w = float(0.0)
        at = float(0.0)
        extent = float(0.0)
        if n < end:
            at = t[n]
            extent = length[n]
            remaining = wp.exp(-sigma[n] * extent)
        before = product_before(transmittance, remaining)
        if n < end:
            w = before * (1.0 - remaining)
            weights[n] = w
            visible_count += wp.where(before > LEAST_TRANSMITTANCE, 1.0, 0.0)
            c += w * values[n]
        w_before = sum_before(total_w, w)
        t_before = sum_before(total_t, w * at)
        # Samples are ordered in t, so |t_i - t_j| needs no absolute value.
        loss += 2.0 * w * (at * w_before - t_before) + w * w * extent / 3.0
        transmittance = last_lane(before * remaining)
        total_w = last_lane(w_before + w)
        total_t = last_lane(t_before + w * at)
        first += lanes
    c = total(c)
    loss = total(loss)
    visible_count = total(visible_count)
    if lane == 0:
        visible[ray] = int(visible_count)
        sums[ray] = c
        opacity[ray] = total_w
        weighted_t[ray] = total_t
        distortion[ray] = loss
        lead[ray] = 0.0
        if counts[ray] > 0:
            lead[ray] = t[end - 1] * total_w - total_t


@wp.kernel
def composite_backward_kernel(
    lanes: int,
    values: wp.array(dtype=Any),  # [N]
    length: wp.array(dtype=float),  # [N]
    t: wp.array(dtype=float),  # [N]
    counts: wp.array(dtype=int),  # [R]
    ends: wp.array(dtype=int),  # [R]
    weights: wp.array(dtype=float),  # [N] of the forward pass, as the next two
    opacity: wp.array(dtype=float),  # [R]
    weighted_t: wp.array(dtype=float),  # [R]
    sums_grad: wp.array(dtype=Any),  # [R]
    opacity_grad: wp.array(dtype=float),  # [R]
    distortion_grad: wp.array(dtype=float),  # [R]
    lead_grad: wp.array(dtype=float),  # [R]
    sigma_grad: wp.array(dtype=float),  # [N] out
    values_grad: wp.array(dtype=Any),  # [N] out
):
    """dL/dτ_i = T_{i+1} v_i - Σ_{j>i} w_j v_j with v = dL/dw; then τ = σ·length."""
    ray = wp.tid() // lanes
    lane = wp.tid() - ray * lanes
    last = ends[ray] - 1
    first = ends[ray] - counts[ray]
    gc = sums_grad[ray]
    go = opacity_grad[ray]
    gd = distortion_grad[ray]
    gl = lead_grad[ray]
    total_w = opacity[ray]
    total_t = weighted_t[ray]
    # Backwards, so that the sums behind piece i are known at piece i.
    behind = float(0.0)  # Σ_{j>i} w_j v_j
    after = float(0.0)  # Σ_{j>i} w_j
    after_t = float(0.0)
    transmittance = float(1.0) - total_w  # T behind the last piece
    farthest = float(0.0)  # t of the last piece
    if last >= first:
        farthest = t[last]
    while last >= first:
        n = last - lane
        w = float(0.0)
        at = float(0.0)
        extent = float(0.0)
        seen = float(0.0)
        if n >= first:
            w = weights[n]
            at = t[n]
            extent = length[n]
            seen = wp.dot(gc, values[n])
        w_after = sum_before(after, w)
        t_after = sum_before(after_t, w * at)
        w_before = total_w - w_after - w
        t_before = total_t - t_after - w * at
        pull = at * w_before - t_before + t_after - at * w_after
        v = seen + go + gd * (2.0 * pull + 2.0 * w * extent / 3.0) + gl * (farthest - at)
        wv_after = sum_before(behind, w * v)
        t_behind = sum_before(transmittance, w)
        if n >= first:
            sigma_grad[n] = extent * (t_behind * v - wv_after)
            values_grad[n] = w * gc
        behind = last_lane(wv_after + w * v)
        after = last_lane(w_after + w)
        after_t = last_lane(t_after + w * at)
        transmittance = last_lane(t_behind + w)
        last -= lanes


for _vector in (wp.vec3, geometry_vector):
    wp.overload(
        composite_kernel, {"values": wp.array(dtype=_vector), "sums": wp.array(dtype=_vector)}
    )
    wp.overload(
        composite_backward_kernel,
        {name: wp.array(dtype=_vector) for name in ("values", "sums_grad", "values_grad")},
    )
