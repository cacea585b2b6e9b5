"""From photographs alone to their cameras and sparse points; see `find_cameras`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "points": ["POINTS_FILE", "SparsePoints", "load_points", "save_points"],
    },
)
