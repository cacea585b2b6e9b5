"""Error of rendering against its run time."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "measure": ["BOUND", "FULL", "LARGEST"],
        "pictures": [
            "differences",
            "image_error",
            "photographs",
            "picture_error",
            "picture_of",
            "views",
        ],
    },
)
