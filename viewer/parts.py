"""The parts of a window, by the names under which functions ask for them.

An action or a panel states what it needs by its parameters: `def focus(viewpoint)` gets the
viewpoint of the scene that is shown, and nothing else.  `call` looks the names up.
"""

import inspect
from functools import cache
from operator import attrgetter

PLACES = {  # of what is no attribute of the window itself
    "say": "recorder.say",
    **{
        name: f"scene.{name}"
        for name in (
            *("settings", "body", "cuts", "handles", "viewpoint", "timeline", "rigging", "posing"),
            *("clock", "journal", "solver", "field", "name", "center", "size", "grab_radius"),
        )
    },
}


def call(function, window, *arguments, **named):
    """Call a function with the parts of a window that its other parameters name.

    Args:
        window: An App, or what has those of its attributes that the function asks for.
        arguments, named: Those that are given, the first ones by their places.

    >>> call(lambda text, say: say(text), SimpleNamespace(recorder=recorder), "hello")
    """
    asked = (name for name in parameters_of(function)[len(arguments) :] if name not in named)
    return function(*arguments, **{name: part(window, name) for name in asked}, **named)


def part(window, name: str):
    return _getter(name)(window)


@cache
def _getter(name):
    return attrgetter(PLACES.get(name, name))


@cache
def parameters_of(function) -> tuple[str, ...]:
    """The names of a function's parameters that have no value of their own."""
    parameters = inspect.signature(function).parameters.values()
    return tuple(one.name for one in parameters if one.default is one.empty)
