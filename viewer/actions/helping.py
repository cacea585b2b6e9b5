"""Actions on the help, and the choice of keys."""

from functools import partial

from ..settings import KEYS
from .action import action, has, toggle


@action("search all actions", "CTRL+F", "Help/Search...", "F3")
def search(questions):
    from .table import ActionSearch  # which looks at all actions

    questions.dialog = ActionSearch()


toggle("show_help", "hide or show the help", "F1", "Help/Keys and gestures")


def _choose_keys(keys, settings, preferences, say):
    """Take one of KEYS, and offer them no longer."""
    settings.keys = preferences.keys = keys
    settings.has_chosen_keys = preferences.has_chosen_keys = True
    say(preferences.save() or f"keys: {KEYS[keys]}'s")


for _keys, _name in KEYS.items():
    action(
        f"the keys and the mouse are {_name}'s",
        menu=f"Help/{'-' * (_keys == 'deformrf')}Keys of {_name}",
        name=f"keys_{_keys}",
        on=has("keys", _keys),
    )(partial(_choose_keys, _keys))
