"""All actions, once their modules are imported: in the order of the menus and of the help."""

from . import filing  # noqa: F401, I001
from . import editing, viewing, photographs, bones, animating, filming, helping  # noqa: F401
from .action import ACTIONS, INPUTS, SECTIONS, Input  # noqa: F401
from .action import action_of, input_of, inputs_of, section_of  # noqa: F401


class BoundActions:
    """The actions of one window, as its buttons, menus and keys call them."""

    def __init__(self, window):
        """Take an App, or what has those of its attributes that actions ask for."""
        self._window = window

    def call(self, name: str) -> None:
        """Do one of ACTIONS."""
        self._window.log("action", name=name)
        ACTIONS[name](self._window)

    def is_on(self, name: str) -> bool:
        return ACTIONS[name].is_on(self._window)

    def input(self, name: str) -> Input:
        """Its key, place and help, with the keys that are chosen."""
        return input_of(name, self._window.scene.settings.keys)

    def title(self, name: str) -> str:
        """What menus and buttons call it now."""
        entry = self.input(name)
        return entry.stop if entry.stop and self.is_on(name) else entry.title

    def label(self, name: str) -> str:
        """The key that calls it, as shown to the user; empty if it has none."""
        return self.input(name).label

    def told(self, name: str, text: str = "") -> str:
        """A text, by default what it does, and the key that calls it, if one does."""
        entry = self.input(name)
        text = text or entry.help
        return f"{text} ({entry.label})" if entry.label else text


class ActionSearch:
    """What is typed to find an action, and which of those found is chosen."""

    title = "Search"

    def __init__(self):
        self.text, self.number = "", 0

    def found(self, keys: str) -> list[Input]:
        """Inputs with an action, all words of the text in what they are called or do."""
        return [one for one in inputs_of(keys) if one.action and told_of(one, self.text)]

    def move(self, by: int, count: int) -> None:
        """Choose another one of so many."""
        self.number = (self.number + by) % max(count, 1)


def told_of(entry: Input, words: str) -> bool:
    """Whether all of these words are in what an input is called, does, or is done with."""
    told = f"{entry.menu} {entry.title} {entry.help} {entry.label}".replace("-", "").lower()
    return all(word in told for word in words.lower().split())
