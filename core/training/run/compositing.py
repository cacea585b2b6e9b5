"""The volume-rendering sum of training rays and its gradients; formulas in render/rounds.

A thread has a ray.  A step of training waits for the longest rays, and they wait for memory.
So a thread loads LOADED samples at once; their sums keep their order.

Shapes: R rays, N packed samples; ray r owns samples ends[r] - counts[r] .. ends[r] - 1.
"""

import warp as wp

LOADED = 8
loaded_vector = wp.types.vector(LOADED, wp.float32)

wp.set_module_options({"enable_backward": False, "max_unroll": LOADED})


@wp.kernel
def composite_kernel(
    sigma: wp.array(dtype=float),  # [N]
    rgb: wp.array(dtype=wp.vec3),  # [N]
    length: wp.array(dtype=float),  # [N]
    t: wp.array(dtype=float),  # [N]
    counts: wp.array(dtype=int),  # [R]
    ends: wp.array(dtype=int),  # [R]
    weights: wp.array(dtype=float),  # [N] out
    color: wp.array(dtype=wp.vec3),  # [R] out
    opacity: wp.array(dtype=float),  # [R] out
    weighted_t: wp.array(dtype=float),  # [R] out: Σ w t
    distortion: wp.array(dtype=float),  # [R] out
):
    """`composite_reference`, with weights."""
    ray = wp.tid()
    end = ends[ray]
    n = end - counts[ray]
    transmittance = float(1.0)
    c = wp.vec3()
    total = float(0.0)  # Σ w_j and Σ w_j t_j of the pieces so far
    total_t = float(0.0)
    loss = float(0.0)
    sigmas, lengths, ts = loaded_vector(), loaded_vector(), loaded_vector()
    reds, greens, blues = loaded_vector(), loaded_vector(), loaded_vector()
    while n < end:
        for k in range(LOADED):
            i = wp.min(n + k, end - 1)
            sigmas[k] = sigma[i]
            lengths[k] = length[i]
            ts[k] = t[i]
            reds[k] = rgb[i][0]
            greens[k] = rgb[i][1]
            blues[k] = rgb[i][2]
        for k in range(LOADED):
            if n + k < end:
                remaining = wp.exp(-sigmas[k] * lengths[k])
                w = transmittance * (1.0 - remaining)
                weights[n + k] = w
                c += w * wp.vec3(reds[k], greens[k], blues[k])
                # Samples are ordered in t, so |t_i - t_j| needs no absolute value.
                loss += 2.0 * w * (ts[k] * total - total_t) + w * w * lengths[k] / 3.0
                total += w
                total_t += w * ts[k]
                transmittance *= remaining
        n += LOADED
    color[ray] = c
    opacity[ray] = total
    weighted_t[ray] = total_t
    distortion[ray] = loss


@wp.kernel
def composite_backward_kernel(
    rgb: wp.array(dtype=wp.vec3),  # [N]
    length: wp.array(dtype=float),  # [N]
    t: wp.array(dtype=float),  # [N]
    counts: wp.array(dtype=int),  # [R]
    ends: wp.array(dtype=int),  # [R]
    weights: wp.array(dtype=float),  # [N] of the forward pass, as the next two
    opacity: wp.array(dtype=float),  # [R]
    weighted_t: wp.array(dtype=float),  # [R]
    color_grad: wp.array(dtype=wp.vec3),  # [R]
    opacity_grad: wp.array(dtype=float),  # [R]
    distortion_grad: wp.array(dtype=float),  # [R]
    sigma_grad: wp.array(dtype=float),  # [N] out
    rgb_grad: wp.array(dtype=wp.vec3),  # [N] out
):
    """dL/dτ_i = T_{i+1} v_i - Σ_{j>i} w_j v_j with v = dL/dw; then τ = σ·length."""
    ray = wp.tid()
    first = ends[ray] - counts[ray]
    gc = color_grad[ray]
    go = opacity_grad[ray]
    gd = distortion_grad[ray]
    total = opacity[ray]
    total_t = weighted_t[ray]
    # Backwards, so that the sums behind piece i are known at piece i.
    behind = float(0.0)  # Σ_{j>i} w_j v_j
    after = float(0.0)  # Σ_{j>i} w_j
    after_t = float(0.0)
    transmittance = float(1.0) - total  # T behind the last piece
    lengths, ts, ws = loaded_vector(), loaded_vector(), loaded_vector()
    reds, greens, blues = loaded_vector(), loaded_vector(), loaded_vector()
    n = ends[ray] - 1
    while n >= first:
        for k in range(LOADED):
            i = wp.max(n - k, first)
            lengths[k] = length[i]
            ts[k] = t[i]
            ws[k] = weights[i]
            reds[k] = rgb[i][0]
            greens[k] = rgb[i][1]
            blues[k] = rgb[i][2]
        for k in range(LOADED):
            if n - k >= first:
                w = ws[k]
                before = total - after - w
                before_t = total_t - after_t - w * ts[k]
                pull = ts[k] * before - before_t + after_t - ts[k] * after
                seen = wp.dot(gc, wp.vec3(reds[k], greens[k], blues[k]))
                v = seen + go + gd * (2.0 * pull + 2.0 * w * lengths[k] / 3.0)
                sigma_grad[n - k] = lengths[k] * (transmittance * v - behind)
                rgb_grad[n - k] = w * gc
                behind += w * v
                after += w
                after_t += w * ts[k]
                transmittance += w
        n -= LOADED
