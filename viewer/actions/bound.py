"""The actions of one window, as its buttons, menus and keys call them."""

from .table import ACTIONS, label_of


class BoundActions:
    """Calls actions with the parts of a window."""

    def __init__(self, window):
        """Take an App, or what has those of its attributes that actions ask for."""
        self._window = window

    def call(self, name: str) -> None:
        """Do one of ACTIONS."""
        self._window.log("action", name=name)
        ACTIONS[name](self._window)

    def is_on(self, name: str) -> bool:
        """Whether a menu checks it."""
        return ACTIONS[name].is_on(self._window)

    def label(self, name: str) -> str:
        """The key that calls it, as shown to the user; empty if it has none."""
        return label_of(name, self._window.scene.settings.keys)

    def with_key(self, name: str, text: str = "") -> str:
        """A text, and the key that calls it, if one does."""
        label = self.label(name)
        return f"{text} ({label})" if text and label else text or label
