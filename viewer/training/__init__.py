"""The model while it is trained (deformrf train --view), and training that the viewer begins."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
