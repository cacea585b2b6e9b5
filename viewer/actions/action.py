"""Actions: functions that `@action` marks, each with its key, its place in the menus and its help.

An action's parameters name the parts of the window that it needs (parts.py).  Key bindings,
menus, tooltips, the search, the help and docs/keys.md follow from what is marked, in the order
in which it stands in the modules of this room.  Gestures of the mouse have no function here.

Of those keys that Blender has for something else, an action also says what they are with
Blender's keys.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from ..parts import call
from ..settings import KEYS
from ..tools import ALT, CTRL, OTHER_NAMES, SHIFT

SECTIONS = (  # of the help: menus, but for the first two
    *("Mouse", "While dragging", "File", "Edit", "Select", "View"),
    *("Rig", "Animate", "Film", "Help"),
)
LABELS = {  # of keys, where they aren't their names
    **{"ESCAPE": "Esc", "BRACKETLEFT": "[", "BRACKETRIGHT": "]", "BACKSLASH": "\\"},
    **{"PERIOD": ".", "PAGEUP": "Page Up", "PAGEDOWN": "Page Down"},
}


@dataclass(frozen=True)
class Input:
    """A gesture, key or item of a menu, and its action."""

    label: str  # the key or gesture, as the help names it; empty for what only a menu has
    help: str  # what it does
    key: str = ""  # pyglet's name of the key, with CTRL+ and SHIFT+ before it if they are held
    action: str = ""  # what key and menu call, one of ACTIONS
    menu: str = ""  # where it is in the menus, as in "Edit/Undo"; "Edit/-Pin": under a line
    blender: str | None = None  # the key with Blender's keys, if another; empty: none
    only: str = ""  # the one of KEYS that has the gesture, if not all

    @property
    def title(self) -> str:
        """What the menus call it; else what it does."""
        return self.menu.rpartition("/")[2].removeprefix("-") or self.help


@dataclass(frozen=True)
class Action:
    """What a key, a menu or a button does to a window."""

    function: Callable  # of parts of the window
    on: Callable | None = None  # likewise: whether it is on; None: it can't be

    def __call__(self, window):
        """Do it."""
        return call(self.function, window)

    def is_on(self, window) -> bool:
        """Whether a menu checks it."""
        return self.on is not None and bool(call(self.on, window))


ACTIONS: dict[str, Action] = {}  # by name
INPUTS: list[Input] = []  # in the order of the menus and of the help


def action(help, key="", menu="", blender=None, name="", on=None):
    """Mark a function as an action.

    Args:
        help, key, menu, blender: As an Input has them.
        name: By which it is called, if not the function's.
        on: A function of parts: whether it is on.
    """

    def decorate(function):
        called = name or function.__name__
        if called in ACTIONS:
            raise ValueError(f"there are two actions {called}")
        ACTIONS[called] = Action(function, on)
        INPUTS.append(Input(label_of_key(key), help, key, called, menu, blender))
        return function

    return decorate


def toggle(setting, help, key="", menu="", blender=None, name=""):
    """Make an action that switches one of the Settings on or off."""

    def switch(settings):
        setattr(settings, setting, not getattr(settings, setting))

    def is_on(settings):
        return getattr(settings, setting)

    action(help, key, menu, blender, name or f"toggle_{setting.removeprefix('show_')}", is_on)(
        switch
    )


def choice(setting, value, help, key="", menu="", name="", otherwise=None):
    """Make an action that gives one of the Settings a value; or another one, if it has that."""

    def choose(settings):
        has_it = otherwise is not None and getattr(settings, setting) == value
        setattr(settings, setting, otherwise if has_it else value)

    def is_on(settings):
        return getattr(settings, setting) == value

    action(help, key, menu, None, name, is_on)(choose)


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
    return entry.menu.partition("/")[0] or "While dragging"


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


def label_of(name: str, keys: str) -> str:
    """The key that calls an action, as shown to the user; empty if it has none."""
    return _table(keys)[2][name].label


def input_of(name: str, keys: str) -> Input:
    """The key, place and help of an action."""
    return _table(keys)[2][name]


_TABLES = {}  # of each of KEYS, once all actions are marked: inputs, actions by key, inputs by name


def _table(keys):
    if keys not in _TABLES:
        inputs = tuple(_with_keys(keys))
        by_key = {entry.key: entry.action for entry in inputs if entry.key}
        _TABLES[keys] = inputs, by_key, {e.action: e for e in inputs if e.action}
    return _TABLES[keys]


def _with_keys(keys):
    """INPUTS as they are with one of KEYS."""
    if keys not in KEYS:
        raise ValueError(f"there are no keys {keys!r}")
    for entry in INPUTS:
        if entry.only in ("", keys):
            other = keys == "blender" and entry.blender is not None
            label = label_of_key(entry.blender) if other else entry.label
            yield replace(entry, key=entry.blender, label=label) if other else entry
