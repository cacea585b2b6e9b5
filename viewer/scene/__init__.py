"""The object in the hand, without a window: its body, handles, grabs and saved views."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
