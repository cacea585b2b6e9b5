"""One frame of the solver: the NumPy reference, the CPU and the CUDA kernel."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "cpu": ["CpuFrame", "takes_halves"],
        "cuda": ["CudaFrame", "runs_in_block"],
    },
)
