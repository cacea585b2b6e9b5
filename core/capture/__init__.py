"""From photographs alone to their cameras and sparse points; see `find_cameras`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "cameras": ["Capture", "IMAGE_SIZE", "MADE_BY", "find_cameras", "summary", "upright"],
        "library": ["load_pycolmap"],
        "photos": ["CaptureError", "photo_folder"],
        "points": ["POINTS_FILE", "SparsePoints", "load_points", "save_points"],
    },
)
