"""Where the mesh overlaps itself: finding the rays that see it, and rendering them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "merging": ["PieceMerger"],
        "search": ["Overlap"],
    },
)
