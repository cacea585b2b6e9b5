"""Bones that pose a mesh: skeletons, clips, weights, skinning, and the files of rigs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
