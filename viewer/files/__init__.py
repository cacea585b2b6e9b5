"""Files that the user opens or saves: dialogs, models and sessions, meshes for other programs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "opening": ["ask_for_file", "open_asked", "open_photographs", "show_model"],
        "dialogs": ["FileDialog", "Problem", "readable"],
        "export": ["save_surface", "surface_of", "with_colors"],
    },
)
