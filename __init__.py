"""DeformRF: a radiance field on a mesh of tetrahedra, which is bent and rendered.

docs/api.md shows how to use it.  Nothing is imported before a name is used: a command first has
to forget the current folder (commands/entry.py), and --help has to answer at once.
"""

_MODULES = {
    "Model": "core.model",
    "load": "core.model",
    "Camera": "core.render",
    "Image": "core.render",
    "from_field_of_view": "core.render",
    "look_at": "core.render",
}
__all__ = sorted(_MODULES)


def __getattr__(name: str):
    from importlib import import_module

    if name == "__version__":
        value = import_module(".core.base.paths", __name__).program_version()
    elif name in _MODULES:
        value = getattr(import_module(f".{_MODULES[name]}", __name__), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__():
    return sorted({*globals(), *__all__, "__version__"})
