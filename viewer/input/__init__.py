"""Mouse and keys: gestures in the view, and the actions of keys, buttons and menus."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
