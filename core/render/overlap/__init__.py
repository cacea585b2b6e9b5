"""Self-overlap of the mesh: finds the rays that meet it, and renders them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "bins": ["TetBins"],
        "merging": ["PieceMerger"],
        "search": ["Overlap"],
        "window_slots": ["WindowSlots"],
        "windows": ["trace_windows_kernel"],
    },
)
