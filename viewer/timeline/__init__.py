"""Keys of camera and pose over time, what plays, and the strip that shows them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
