"""From photographs alone to their cameras and sparse points; see `find_cameras`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
