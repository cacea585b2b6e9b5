"""Actions: functions that `@action` marks, each with its key, its place in the menus and its help.

An action's parameters name the parts of the window that it needs (parts.py).  Key bindings,
menus, tooltips, the search, the help and docs/keys.md follow from what is marked, in the order
in which it stands in the modules of this room.  Gestures of the mouse have no function here.

Of those keys that Blender has for something else, an action also says what they are with
Blender's keys.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

from ..parts import call, part
from ..settings import KEYS
from ..tools import ALT, CTRL, OTHER_NAMES, SHIFT

SECTIONS = (  # of the help: tasks, and what belongs to all of them
    *("Mouse", "While dragging", "Bend", "Rig", "Animate", "Film", "View", "File", "Help"),
)
EXPORT = "File/Export"  # whose items say what; elsewhere "Export" is told, too
LABELS = {  # of keys, where they aren't their names
    **{"ESCAPE": "Esc", "BRACKETLEFT": "[", "BRACKETRIGHT": "]", "BACKSLASH": "\\"},
    **{"PERIOD": ".", "PAGEUP": "Page Up", "PAGEDOWN": "Page Down"},
}


@dataclass(frozen=True)
class Input:
    """A gesture, key or item of a menu, and what it does to a window."""

    label: str  # the key or gesture, as the help names it; empty for what only a menu has
    help: str  # what it does
    key: str = ""  # pyglet's name of the key, with CTRL+ and SHIFT+ before it if they are held
    action: str = ""  # what key and menu call, one of ACTIONS
    menu: str = ""  # where it is in the menus, as in "Edit/Undo"; "Edit/-Pin": under a line
    blender: str | None = None  # the key with Blender's keys, if another; empty: none
    only: str = ""  # the one of KEYS that has the gesture, if not all
    stop: str = ""  # its title while it is on, instead of a mark in the menu
    function: Callable | str | None = None  # as parts.call takes it; None: a gesture has none
    on: Callable | str | None = None  # whether it is on, or the path of that; None: it can't be

    @property
    def title(self) -> str:
        """What menus, buttons and the search call it; else what it does."""
        menu, _, last = self.menu.rpartition("/")
        last = last.removeprefix("-")
        return f"Export {last[0].lower()}{last[1:]}" if menu == EXPORT else last or self.help

    @property
    def is_checked(self) -> bool:
        """Whether menus check it while it is on."""
        return self.on is not None and not self.stop

    def __call__(self, window):
        return call(self.function, window)

    def is_on(self, window) -> bool:
        """Whether it is on now."""
        if isinstance(self.on, str):
            return bool(part(window, self.on))
        return self.on is not None and bool(call(self.on, window))


ACTIONS: dict[str, Input] = {}  # those that have a function, by name
INPUTS: list[Input] = []  # in the order of the menus and of the help


def action(help, key="", menu="", blender=None, name="", on=None, stop=""):
    """Mark a function as an action.

    Args:
        help, key, menu, blender, stop: As an Input has them.
        name: By which it is called, if not the function's.
        on: A function of parts: whether it is on; or a path, as "clock.paused".
    """

    def decorate(function):
        called = name or function.__name__
        if called in ACTIONS:
            raise ValueError(f"there are two actions {called}")
        done = {"stop": stop, "function": function, "on": on}
        ACTIONS[called] = Input(label_of_key(key), help, key, called, menu, blender, **done)
        INPUTS.append(ACTIONS[called])
        return function

    return decorate


def method(path, help, key="", menu="", blender=None, name="", on=None, stop=""):
    """Make an action that calls a method of a part, as "viewpoint.home"."""
    action(help, key, menu, blender, name or path.rpartition(".")[2], on, stop)(path)


def choice(setting, value, help, key="", menu="", blender=None, name="", otherwise=None):
    """Make an action that gives one of the Settings a value; or another one, if it has that."""

    is_on = has(setting, value)

    def choose(settings):
        other = otherwise is not None and is_on(settings)
        setattr(settings, setting, otherwise if other else value)

    action(help, key, menu, blender, name, is_on)(choose)


def has(setting, value):
    """A function of settings: whether one of them has this value."""

    def is_on(settings):
        return getattr(settings, setting) == value

    return is_on


def toggle(setting, help, key="", menu="", blender=None, name=""):
    """Make an action that switches one of the Settings on or off."""
    name = name or f"toggle_{setting.removeprefix('show_')}"
    choice(setting, True, help, key, menu, blender, name, otherwise=False)


def gesture(label, help, only="") -> None:
    """Note what the mouse does, for the help."""
    INPUTS.append(Input(label, help, only=only))


def label_of_key(key: str) -> str:
    """As "Ctrl+Tab" for "CTRL+TAB", and "Shift+1" for "SHIFT+_1"."""
    parts = key.split("+")
    return "+".join(LABELS.get(one, one.removeprefix("_").capitalize()) for one in parts if one)


def inputs_of(keys: str) -> tuple[Input, ...]:
    """The inputs that there are with one of KEYS, with their labels and keys."""
    return _table(keys)[0]


def section_of(entry: Input) -> str:
    """The one of SECTIONS in which the help has an input."""
    if not entry.action:
        return "Mouse"
    menu = entry.menu.partition("/")[0] or "While dragging"
    return "Bend" if menu in ("Edit", "Select") else menu


def action_of(key: str, modifiers: int = 0, keys: str = "deformrf") -> str | None:
    """The action of a key, by pyglet's name of it and the modifiers that are held.

    Shift or Alt alone changes no key that has no action with it.
    """
    actions, key = _table(keys)[1], OTHER_NAMES.get(key, key)
    ctrl, alt, shift = (bool(modifiers & one) for one in (CTRL, ALT, SHIFT))
    found = actions.get("CTRL+" * ctrl + "ALT+" * alt + "SHIFT+" * shift + key)
    if found is None and alt:
        found = action_of(key, modifiers & ~ALT, keys)
    return actions.get(key) if found is None and not ctrl else found


def input_of(name: str, keys: str) -> Input:
    """The key, place and help of an action."""
    return _table(keys)[2][name]


@cache
def _table(keys):
    """Inputs, actions by key, and inputs by action; once all actions are marked."""
    if keys not in KEYS:
        raise ValueError(f"there are no keys {keys!r}")
    inputs = tuple(
        replace(one, key=one.blender, label=label_of_key(one.blender))
        if keys == "blender" and one.blender is not None
        else one
        for one in INPUTS
        if one.only in ("", keys)
    )
    by_key = {one.key: one.action for one in inputs if one.key}
    return inputs, by_key, {one.action: one for one in inputs if one.action}
