"""What was done to a scene: edits are recorded on ticks, and can be undone."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
