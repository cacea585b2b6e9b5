"""List the Warp modules of rendering, for the viewer to compile before the first frame."""

import warp as wp

from ..field import encode_kernel, networks_kernel
from . import deferred, modes, shading, subpixel
from .overlap.merging import PieceMerger
from .overlap.search import Overlap
from .overlap.windows import trace_windows_kernel
from .rays.camera import camera_rays_kernel
from .rays.marching import march_kernel
from .rays.pose import Pose
from .rays.raster import raster_kernel
from .render import Renderer
from .rounds.compositing import resolve_kernel
from .rounds.cpu import trace_kernel


def kernel_modules(device: wp.DeviceLike) -> list[str]:
    """Names of those that `Renderer`, `render_mode` and `RunningMean` launch on a device."""
    names = [owner.__module__ for owner in (Renderer, Pose, Overlap)]
    names += [module.__name__ for module in (modes, subpixel)]
    kernels = [camera_rays_kernel, resolve_kernel]
    if str(device).startswith("cuda"):
        from .overlap.bins import TetBins
        from .overlap.window_slots import WindowSlots
        from .rounds.ray_color import paint_kernel
        from .rounds.slot_densities import slot_densities_kernel
        from .rounds.slot_march import march_slots_kernel
        from .rounds.slot_shading import shade_slots_kernel
        from .rounds.slots import begin_kernel

        names += [owner.__module__ for owner in (PieceMerger, TetBins, WindowSlots)]
        kernels += [march_kernel, begin_kernel, paint_kernel, deferred.means_kernel]
        kernels += [encode_kernel, shading.half_basis_kernel, networks_kernel]
        kernels += [march_slots_kernel, shade_slots_kernel, slot_densities_kernel]
    else:  # what crowded rays need is compiled when there are any
        kernels += [raster_kernel, trace_kernel, trace_windows_kernel]
    return sorted({*names, *(kernel.module.name for kernel in kernels)})
