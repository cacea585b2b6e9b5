"""Keys of camera and pose over time, what plays, and the strip that shows them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "timeline": ["MOTIONS", "TRACKS", "Timeline", "WEIGHTS"],
        "keys": ["CameraKey", "EASINGS", "LONGEST", "orbit_at"],
        "strip": ["Scale", "Strip", "TICKS_PER_SECOND", "as_time", "shown_ticks"],
    },
)
