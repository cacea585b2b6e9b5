"""What keys, menus, buttons and the search call: functions with their keys, places and help."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
