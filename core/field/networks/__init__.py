"""The two networks, one module for each place that they run in."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "reference": [
            "ACTIVATIONS",
            "BASIS_COUNT",
            "GEOMETRY_FEATURES",
            "evaluate",
            "spherical_harmonics",
        ],
    },
)
