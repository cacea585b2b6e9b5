"""The report as files: page, Markdown, JSON, tables and plots."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=["machine"],
    submod_attrs={
        "parts": ["Figure", "Report", "Section", "Table"],
        "plots": ["INK", "label", "new_figure", "png"],
        "writing": ["is_complete", "write"],
    },
)
