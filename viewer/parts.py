"""The parts of a window, by the names under which functions ask for them.

An action or a panel states what it needs by its parameters: `def next_view(viewpoint, say)` gets
the viewpoint of the scene that is shown, and what tells the user.  `call` looks the names up.
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


def call(function, window, *arguments):
    """Call a function with the parts of a window that its other parameters name.

    Args:
        function: Or the path of a method of a part that needs no others, as "viewpoint.home".
        window: An App, or what has those of its attributes that the function asks for.
        arguments: Those that are given, by their places.

    >>> call(lambda text, say: say(text), SimpleNamespace(recorder=recorder), "hello")
    """
    if isinstance(function, str):
        return part(window, function)()
    asked = parameters_of(function)[len(arguments) :]
    return function(*arguments, *(part(window, name) for name in asked))


def part(window, name: str):
    """A part, or an attribute of one, as "clock.paused"."""
    return _getter(name)(window)


@cache
def _getter(name):
    first, *rest = name.split(".")
    return attrgetter(".".join([PLACES.get(first, first), *rest]))


@cache
def parameters_of(function) -> tuple[str, ...]:
    """The names of a function's parameters that have no value of their own; or its path."""
    if isinstance(function, str):
        return (function,)
    parameters = inspect.signature(function).parameters.values()
    return tuple(one.name for one in parameters if one.default is one.empty)
