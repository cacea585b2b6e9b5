"""One color per ray: h and directions are summed along a ray, and their means give its color.

This applies to fields with `FieldOptions.deferred`.  Each sample has h from the density network
and the rest direction Qᵀd.  A ray sums both, with the samples' weights.  When it ends, the color
network is evaluated once, for the means.  `ray_colors` of core/definition/image.py defines the
color.

Shapes: R rays, n of them in a launch, N packed samples, T tets.
"""

import warp as wp

from ..base.wide import vec4h
from ..field import CONSTANT_BASIS, GEOMETRY_FEATURES, basis_of, basis_vector
from .rays.marching import Rays, RaySamples
from .rounds.compositing import Pixels, ray_sums
from .rounds.cpu import SMALLEST

AT_ONCE = 1 << 18  # rays: torch takes a kilobyte for each, a layer

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.kernel
def values_kernel(
    rays: Rays,
    rotations: wp.array(dtype=wp.mat33),  # [T] Q
    found: RaySamples,
    h: wp.array2d(dtype=float),  # [N, 16]
    values: wp.array(dtype=ray_sums),  # [N] out
):
    """What each packed sample adds to the sums of its ray, without its weight."""
    i = wp.tid()
    direction = rays.directions[found.ids[i]]
    n = found.ends[i] - found.counts[i]
    while n < found.ends[i]:
        value = ray_sums()
        k = int(0)
        while k < wp.static(GEOMETRY_FEATURES):
            value[k] = h[n, k]
            k += 1
        turned = wp.transpose(rotations[found.samples.tet[n]]) * direction
        k = int(0)
        while k < 3:
            value[wp.static(GEOMETRY_FEATURES) + k] = turned[k]
            k += 1
        values[n] = value
        n += 1


@wp.func
def mean_basis(sums: ray_sums, has_directions: int):
    """Y of the mean of a ray's rest directions."""
    b = basis_vector()
    b[0] = wp.static(CONSTANT_BASIS[0])
    if has_directions == 1:
        first = wp.static(GEOMETRY_FEATURES)
        d = wp.vec3(sums[first], sums[first + 1], sums[first + 2])
        b = basis_of(d / wp.max(wp.length(d), wp.static(SMALLEST)))
    return b


@wp.kernel
def means_kernel(
    pixels: Pixels,
    ids: wp.array(dtype=int),  # [n]
    has_directions: int,
    h: wp.array2d(dtype=float),  # [n, 16] out
    basis: wp.array(dtype=basis_vector),  # [n] out
):
    i = wp.tid()
    ray = ids[i]
    sums = pixels.sums[ray]
    opacity = wp.max(1.0 - pixels.transmittance[ray], wp.static(SMALLEST))
    k = int(0)
    while k < wp.static(GEOMETRY_FEATURES):
        h[i, k] = sums[k] / opacity
        k += 1
    basis[i] = mean_basis(sums, has_directions)


@wp.kernel
def put_colors_kernel(
    ids: wp.array(dtype=int),  # [n]
    rgb: wp.array(dtype=wp.vec3),  # [n]
    pixels: Pixels,  # its color is out
):
    ray = ids[wp.tid()]
    pixels.color[ray] = (1.0 - pixels.transmittance[ray]) * rgb[wp.tid()]


@wp.kernel
def half_rows_kernel(
    h: wp.array2d(dtype=float),  # [n, 16]
    basis: wp.array(dtype=basis_vector),  # [n]
    x: wp.array2d(dtype=wp.float16),  # [n, 32] out
):
    i, k = wp.tid()
    x[i, k] = wp.float16(h[i, k])
    x[i, wp.static(GEOMETRY_FEATURES) + k] = wp.float16(basis[i][k])


def colors_in_place(networks):
    """The `colors` that `color_rays` takes, of tensor cores (TensorCoreNetworks)."""

    def colors(h, basis):
        count, device = h.shape[0], h.device
        x = wp.empty((count, 2 * GEOMETRY_FEATURES), dtype=wp.float16, device=device)
        wp.launch(half_rows_kernel, (count, GEOMETRY_FEATURES), [h, basis], [x], device=device)
        fours = wp.array(ptr=x.ptr, dtype=vec4h, shape=8 * count, device=device)
        rgb = wp.empty(count, dtype=wp.vec3, device=device)
        networks.colors(fours, wp.full(1, count, dtype=int, device=device), rgb)
        return rgb

    return colors


def color_rays(colors, view_dependence: bool, ids, pixels: Pixels):
    """Write the colors of the rays `ids` [n], which have come to their ends.

    Args:
        colors: colors(h [n, 16], basis [n]) -> rgb [n].
    """
    for first in range(0, len(ids), AT_ONCE):
        some = ids[first : min(first + AT_ONCE, len(ids))]  # Warp takes no slice beyond the end
        count, device = len(some), ids.device
        h = wp.empty((count, GEOMETRY_FEATURES), dtype=float, device=device)
        basis = wp.empty(count, dtype=basis_vector, device=device)
        inputs = [pixels, some, int(view_dependence)]
        wp.launch(means_kernel, count, inputs, [h, basis], device=device)
        wp.launch(put_colors_kernel, count, [some, colors(h, basis)], [pixels], device=device)
