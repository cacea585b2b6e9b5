"""Bones in the viewer: how they are made, posed and played, and how they move the object."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
