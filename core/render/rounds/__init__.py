"""Rounds of march, shade and composite until no ray is left."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "compositing": ["Pixels", "empty_pixels", "resolve", "resolve_kernel", "to_bytes"],
        "cpu": ["CpuShader", "NativeShading", "shade_native", "trace_kernel"],
        "host": ["HostRounds"],
        "slots": ["begin_kernel"],
        "wavefront": ["Wavefront"],
    },
)
