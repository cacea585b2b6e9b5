"""Photographs to a field: data sets, the two stages, evaluation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "data.capture": ["DatasetError"],
        "data.datasets": ["Dataset", "white_composite"],
        "data.scene_box": ["world_to_unit_cube"],
        "evaluation": ["lacks_surroundings"],
        "options": ["preset"],
    },
)
