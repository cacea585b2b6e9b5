"""Where one looks from: the orbit camera, what lies at a pixel, photographs' cameras."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
