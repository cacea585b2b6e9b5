"""The panels: each a function of (scene, actions, status) that draws one section.

They read the scene and the status, and change things through the scene's methods, its
settings and `actions`, the same methods that the keys call.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submod_attrs={"layout": ["draw_panels"], "loading": ["loading_window"]}
)
