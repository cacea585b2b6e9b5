"""Checks of values take what they say and nothing else; arrays are checked before they are read."""

import math

import numpy as np
import pytest

from deformrf.core.base.schema import (
    FileError,
    array,
    both,
    check,
    declared,
    flag,
    integer,
    listing,
    mapping,
    number,
    one_of,
    optional,
    row,
    text,
    vector,
)

HUGE = 10**400  # a whole number that no float is as large as


@pytest.mark.parametrize(
    ("checks", "good", "bad"),
    [
        (flag, [True, False], [0, 1, None, "true"]),
        (number(-1, 2.5), [-1, 0.0, 2.5], [-1.001, 3, math.nan, math.inf, True, "1", None, HUGE]),
        (number(), [-1e308, 0, 10**300], [math.nan, math.inf, -math.inf, False, HUGE, [1]]),
        (integer(2, 4), [2, 3, 4], [1, 5, 2.0, True, "3"]),
        (text(3, least=1), ["a", "abc", "\n"], ["", "abcd", b"a", ["a"], None]),
        (one_of(("a", "b")), ["a", "b"], ["c", 1, ["a"], {}, None]),
        (one_of({"a": 1}), ["a"], ["b", ["a"]]),
        (optional(flag), [None, True], [0]),
        (both(text(), str.isprintable), ["", "a"], ["\x1b", 1]),
        (listing(flag, 2), [[], [True], (True, False)], [[True] * 3, [1], "ab", {True: 1}, None]),
        (vector(2, flag), [[True, False], (True, True)], [[], [True], [True] * 3, [True, 0], {}]),
        (row(flag, integer(1)), [[False, 1]], [[1, False], [False], [False, 1, 1], "ab"]),
        (
            mapping({"a": flag, "b": number()}),
            [{"b": 1, "a": True}],
            [{"a": True}, {"a": 1, "b": 1}],
        ),
        (mapping({"a": flag}), [{"a": False}], [{"a": True, "b": 1}, {}, ["a"], "a", None]),
    ],
)
def test_a_check_takes_what_it_says(checks, good, bad):
    for value in good:
        assert checks(value), value
    for value in bad:
        assert not checks(value), value


def test_what_does_not_hold_is_a_sentence():
    check(True, "it is fine")
    with pytest.raises(FileError, match=r"^it is not$"):
        check([], "it is not")
    assert issubclass(FileError, ValueError)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (np.zeros((5, 3), np.int64), r"int64 \[5, 3\].* uint16 or int32 \['any', 3\]"),
        (np.zeros((5, 4), np.int32), r"int32 \[5, 4\]"),
        (np.zeros(5, np.int32), r"int32 \[5\]"),
    ],
)
def test_a_wrong_array_is_named_with_what_it_should_be(found, words):
    with pytest.raises(FileError, match=words):
        array({"a": found}, "a", (np.uint16, np.int32), (None, 3))


def test_an_array_is_there_finite_and_of_any_length_where_that_is_free():
    values = np.random.default_rng().normal(size=(4, 3))
    np.testing.assert_array_equal(array({"a": values}, "a", "f8", (None, 3)), values)
    with pytest.raises(FileError, match=r"^the array 'b' is missing$"):
        array({"a": values}, "b", "f8", (4, 3))
    values[2, 1] = np.nan
    with pytest.raises(FileError, match=r"^'a' holds NaN or infinite values$"):
        array({"a": values}, "a", "f8", (4, 3))


def test_a_declared_array_is_not_read():
    class Stored:
        dtype, shape, ndim = np.dtype("f8"), (4, 3), 2

        def __array__(self, dtype=None, copy=None):
            raise AssertionError("it is read")

    stored = Stored()
    assert declared({"a": stored}, "a", np.float64, (4, 3)) is stored
    with pytest.raises(FileError, match="it should be float64"):
        array({"a": stored}, "a", np.float64, (5, 3))
