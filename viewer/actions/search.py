"""The search over all actions, without drawing."""

from .table import inputs_of


class ActionSearch:
    """What is typed to find an action, and which of those found is chosen."""

    title = "Search"

    def __init__(self):
        self.text, self.number = "", 0

    def found(self, keys: str):
        """Inputs with an action, all words of the text in what they are called or do."""
        words = self.text.lower().split()
        named = [one for one in inputs_of(keys) if one.action]
        return [one for one in named if all(word in _told(one) for word in words)]

    def move(self, by: int, count: int) -> None:
        """Choose another one of so many."""
        self.number = (self.number + by) % max(count, 1)


def _told(entry):
    return f"{entry.menu} {entry.help} {entry.label}".replace("-", "").lower()
