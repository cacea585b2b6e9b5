"""Spherical harmonics on devices; core/definition/networks.py defines them."""

import warp as wp

BASIS_COUNT = 16  # of degree < 4
CONSTANT_BASIS = (0.28209479177387814, *[0.0] * (BASIS_COUNT - 1))  # no direction in it

basis_vector = wp.types.vector(length=BASIS_COUNT, dtype=wp.float32)


@wp.func
def basis_of(d: wp.vec3):
    """`spherical_harmonics` of one direction."""
    x = d[0]
    y = d[1]
    z = d[2]
    xx = x * x
    yy = y * y
    zz = z * z
    return basis_vector(
        0.28209479177387814,
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (3.0 * zz - 1.0),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3.0 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (5.0 * zz - 1.0),
        0.3731763325901154 * z * (5.0 * zz - 3.0),
        -0.4570457994644658 * x * (5.0 * zz - 1.0),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3.0 * yy),
    )
