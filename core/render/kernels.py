"""List the Warp modules of rendering, for the viewer to compile before the first frame."""

import warp as wp

from ..field import encode_kernel, networks_kernel
from . import cpu_tiles, deferred, modes, render, shading, subpixel, upsampling
from .overlap import merging, search
from .rays import camera, marching, pose
from .rounds import compositing, cpu


def kernel_modules(device: wp.DeviceLike) -> list[str]:
    """Names of those that rendering launches on a device; those of upsampling run on a CPU."""
    modules, names = [pose, search, modes, subpixel], []
    if str(device).startswith("cuda"):
        from .overlap import bins, window_slots
        from .rounds import ray_color, slot_densities, slot_march, slots, tracing

        names = [kernel.module.name for kernel in (encode_kernel, networks_kernel)]
        modules += [render, camera, compositing, merging, bins, window_slots, marching, slots]
        modules += [ray_color, deferred, shading, slot_march, slot_densities, tracing]
    else:  # overlap/windows.py is compiled with cpu.py; what crowded rays need, if there are any
        modules += [cpu_tiles, cpu, upsampling]
    return sorted({*names, *(module.__name__ for module in modules)})
