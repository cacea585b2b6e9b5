"""List the Warp modules of dynamics, for the viewer to compile before the first frame."""

import warp as wp

from .contact.contact import contact_modules
from .frame.cpu import CpuFrame
from .frame.cuda import CudaFrame
from .rigid_motion import FreeParts
from .tangles import Feedback


def kernel_modules(device: wp.DeviceLike) -> list[str]:
    """Names of the Warp modules whose kernels a solver launches on a device.

    On CUDA a frame's main kernel, which depends on the mesh's size, is a module of its own
    that is not among them.
    """
    frame = CudaFrame if str(device).startswith("cuda") else CpuFrame
    of_frames = Feedback.__module__, FreeParts.__module__, frame.__module__
    return [*of_frames, *contact_modules()]
