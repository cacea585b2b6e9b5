"""Stress cases: what the solver and the renderer survive."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "tell": ["SEED"],
    },
)
