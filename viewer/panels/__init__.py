"""The panels: functions that draw, with Dear ImGui, what they get as arguments.

Their parameters name the parts of the window that they show (parts.py).  They change something
through methods of these parts and through actions, which keys and menus call, too.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
