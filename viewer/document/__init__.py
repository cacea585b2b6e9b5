"""What is open: the object in the hand, what was done to it, its time, bones and sessions."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
