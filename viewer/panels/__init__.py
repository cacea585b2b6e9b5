"""The panels: each a function of the App that draws one section.

They read the App's state, and change it through the scene's methods, its settings, and the
actions, which the keys call too.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
