"""The radiance field: features at nested tetrahedra, two networks, and the model file."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
