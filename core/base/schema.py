"""Checks that run on a file's values and arrays before these are used.

A check is a function that returns whether a value is good: `number(0.0, 1.0)(0.5)` is true.  Values
have JSON's types; true and false are not numbers, and a tuple counts as a list.  `declared` and
`array` check an array by the type and shape that it declares, before any of its values take memory.
"""

import sys
from collections.abc import Callable, Container

import numpy as np

LARGEST = sys.float_info.max
Check = Callable[[object], bool]


class FileError(ValueError):
    """What a file holds can't be used; the message is one sentence for the user."""


def check(condition, sentence: str) -> None:
    """Raise a FileError with the sentence unless the condition holds."""
    if not condition:
        raise FileError(sentence)


# -- values ------------------------------------------------------------------------------------


def flag(value) -> bool:
    return isinstance(value, bool)


def number(low: float = -LARGEST, high: float = LARGEST, kinds=int | float) -> Check:
    """A finite number in a range, both ends included."""
    return lambda value: (
        isinstance(value, kinds) and not isinstance(value, bool) and low <= value <= high
    )


def integer(low: float = -LARGEST, high: float = LARGEST) -> Check:
    """A whole number in a range, both ends included."""
    return number(low, high, int)


def text(most: float = LARGEST, least: int = 0) -> Check:
    """Text of a length, both ends included."""
    return lambda value: isinstance(value, str) and least <= len(value) <= most


def one_of(choices: Container[str]) -> Check:
    return lambda value: isinstance(value, str) and value in choices


def optional(good: Check) -> Check:
    """None, or what is good."""
    return lambda value: value is None or good(value)


def both(first: Check, second: Check) -> Check:
    """What passes the first check, and then the second."""
    return lambda value: first(value) and second(value)


def listing(good: Check, most: float = LARGEST) -> Check:
    """A list of at most so many values."""
    return lambda value: (
        isinstance(value, list | tuple) and len(value) <= most and all(map(good, value))
    )


def row(*checks: Check) -> Check:
    """A list with one value for each check."""
    return lambda value: (
        isinstance(value, list | tuple)
        and len(value) == len(checks)
        and all(good(one) for good, one in zip(checks, value, strict=True))
    )


def vector(count: int, good: Check) -> Check:
    """A list of exactly so many values."""
    return row(*[good] * count)


def by_name(good: Check) -> Check:
    """An object with any keys, whose values are good."""
    return lambda value: isinstance(value, dict) and all(map(good, value.values()))


def mapping(checks: dict[str, Check]) -> Check:
    """An object with these keys and no others."""
    return lambda value: (
        isinstance(value, dict)
        and value.keys() == checks.keys()
        and all(good(value[key]) for key, good in checks.items())
    )


# -- arrays ------------------------------------------------------------------------------------


def declared(arrays, name: str, dtypes, shape: tuple):
    """The named array, not read, if it has that type (or one of a tuple) and shape.

    None in the shape stands for any length.

    Raises:
        FileError: It is missing or another one.
    """
    dtypes = dtypes if isinstance(dtypes, tuple) else (dtypes,)
    check(name in arrays, f"the array '{name}' is missing")
    found = arrays[name]
    fits = found.ndim == len(shape) and all(
        want is None or want == have for want, have in zip(shape, found.shape, strict=True)
    )
    check(
        found.dtype in dtypes and fits,
        f"'{name}' is {found.dtype} {list(found.shape)}, "
        f"it should be {' or '.join(str(np.dtype(t)) for t in dtypes)} "
        f"{['any' if s is None else s for s in shape]}",
    )
    return found


def array(arrays, name: str, dtypes, shape: tuple) -> np.ndarray:
    """The values of an array that is as `declared` wants it, and finite."""
    found = np.asarray(declared(arrays, name, dtypes, shape))
    if found.dtype.kind == "f":
        check(np.isfinite(found).all(), f"'{name}' holds NaN or infinite values")
    return found
