"""Device functions that evaluate the density network on tensor cores within another kernel.

The kernel's warps take 32 rows (samples) at a time.  The kernel calls `share_density` once, to load
the weights into shared memory.  For each row it calls `put_features`, level by level.  Then all
threads of the warp together call one of two functions.  `density_of_rows` writes results to arrays.
`density_in_shared` leaves them in shared memory, where `sigma_in_shared` and `h_in_shared` read
them.  Features never pass through the device's memory.  mma.py describes how a warp multiplies.  On
a CPU and on older GPUs these functions compute nothing.
"""

import warp as wp

from ...base.wide import vec4h
from .mma import tensor_core_body

BLOCK_SIZE = 128  # of the kernel
OVERWRITTEN_LEVELS = wp.constant(4)  # by density_in_shared


def _body(name: str, otherwise=""):
    return tensor_core_body("density_rows.cu", name, otherwise, BLOCK_SIZE=BLOCK_SIZE)


@wp.func_native(_body("share_density", otherwise="return 0;"))
def share_density(fragments: wp.array(dtype=vec4h), biases: wp.array(dtype=float)) -> wp.uint64:
    """Where the block's shared memory is, with the weights in it.  All threads call it."""
    ...


@wp.func_native(_body("put_features"))
def put_features(shared: wp.uint64, level: int, f: wp.vec4):
    """Put a level's features of this thread's row; those that nobody ever put are zero."""
    ...


@wp.func_native(_body("density_of_rows"))
def density_of_rows(
    shared: wp.uint64,
    n: int,  # this thread's row, a multiple of 32 and its place in the warp
    sigma: wp.array(dtype=float),  # [N] out
    h: wp.array(dtype=vec4h),  # [4 N] out
): ...


@wp.func_native(_body("density_in_shared"))
def density_in_shared(shared: wp.uint64):
    """Find density and h.

    h takes the place of the features of OVERWRITTEN_LEVELS, the first ones: all of these have to
    be put again before the next call.  The density lies behind the features.
    """
    ...


@wp.func_native(_body("sigma_in_shared", otherwise="return 0.0f;"))
def sigma_in_shared(shared: wp.uint64) -> float:
    """The density of this thread's row."""
    ...


@wp.func_native(_body("h_in_shared", otherwise="return wp::vec_t<4, wp::float32>();"))
def h_in_shared(shared: wp.uint64, k: int) -> wp.vec4:
    """Numbers 4 k .. 4 k + 3 of h of this thread's row."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __any_sync(0xffffffffu, flag) != 0;
#else
    return flag;
#endif
""")
def any_of_warp(flag: bool) -> bool: ...
