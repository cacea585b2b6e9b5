"""What was done to a scene: edits are recorded on ticks, and can be undone."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "journal": ["EDITS", "MAY_BE_INFINITE", "Event", "Journal", "edit"],
        "undo": ["begin_anew", "is_nothing", "restore", "state_of", "unless_it_fails"],
    },
)
