"""What is worked out once, until something that it follows from is replaced."""

from operator import is_


class Kept:
    """One value, kept as long as all that it follows from are the same objects.

    Arrays among these may not be changed in place.
    """

    def __init__(self):
        self._follows_from, self._value = None, None

    def of(self, follows_from: tuple, work):
        """The value of `work()`, as it was if these objects are those of the last call."""
        kept = self._follows_from
        if kept is None or not all(map(is_, follows_from, kept)):
            self._value = work()
            self._follows_from = follows_from
        return self._value
