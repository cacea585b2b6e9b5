"""The object in the hand, without a window: its body, handles, grabs and saved views."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "scene": ["Scene"],
        "body": ["EARTH"],
        "cuts": ["masks_of"],
        "handles": ["MOST_ADDED"],
        "points": ["ControlPoints", "MOST_POINTS"],
        "grabs": ["rotation_matrix", "rotation_vector"],
        "surface": ["visible_points"],
        "viewpoint": ["LONGEST_NAME", "clean_name"],
    },
)
