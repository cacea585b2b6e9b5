"""Contact of a mesh with itself: where parts of it touch, and what then moves their vertices."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "contact": ["Contact", "contact_modules"],
        "reference": ["ContactList", "no_contacts", "pushed"],
    },
)
