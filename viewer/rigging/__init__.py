"""Bones in the viewer: how they are made, posed and played, and how they move the object."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "rigging": ["MOST_JOINTS", "Rigging", "rig_of"],
        "posing": ["Posing", "SPEEDS"],
        "joints": ["ENDS", "HEAD", "LOOSE", "TAIL", "Joint", "joint_mask"],
        "matter": ["Matter"],
        "hold": ["Hold"],
    },
)
