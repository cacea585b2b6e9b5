"""Printing to standard output and error.  A failed print never stops the work.

If the terminal was closed, a pipe has no reader or a disk is full, the text is lost.  Streams that
were closed before the start are opened on the null device.  Otherwise a file could get descriptor
2, to which libraries write their warnings.
"""

import os
import reprlib
import sys

LAST_STANDARD = 2  # descriptor: of standard error
SHORT = reprlib.Repr()
SHORT.maxlevel, SHORT.maxstring, SHORT.maxother = 3, 60, 60


class Stream:
    """A text stream whose writing never fails.

    Attributes:
        failure: The first error, after which nothing more is written; None without one.
    """

    def __init__(self, stream):
        self._stream = stream
        self.failure: Exception | None = None
        if hasattr(stream, "reconfigure"):  # a file's name may hold what no encoding has
            stream.reconfigure(errors="backslashreplace")

    def write(self, text: str) -> int:
        self._attempt(self._stream.write, text)
        return len(text)

    def writelines(self, lines):
        for line in lines:
            self.write(line)

    def flush(self):
        self._attempt(self._stream.flush)

    def _attempt(self, act, *arguments):
        if self.failure is None:
            try:
                act(*arguments)
            except (OSError, ValueError) as error:  # ValueError: of a closed file
                self.failure = error

    def __getattr__(self, name):
        return getattr(self._stream, name)


def keep_going() -> None:
    """From now on no print and no progress bar raises an error, wherever it is written to."""
    _occupy_numbers()
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:  # it was closed before the start
            stream = open(os.devnull, mode, encoding="utf-8")
            setattr(sys, name, stream)
        if name != "stdin" and not isinstance(stream, Stream):
            setattr(sys, name, Stream(stream))


def _occupy_numbers():
    """Open the system's empty file under those of the descriptors 0 to 2 that are closed."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= LAST_STANDARD:  # the lowest that is free
        os.set_inheritable(number, True)  # for programs that are started
    os.close(number)


def printable(words) -> str:
    """Words as one line for a terminal: control characters as their codes, such as \\x1b.

    Names and contents of files may hold escape codes, or bytes that are no text.
    """
    text = str(words).encode("utf-8", "backslashreplace").decode()
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def one_line(error, most: int = 300) -> str:
    """An error's words in one line of at most so many characters: they may quote a file."""
    return printable(" ".join(str(error)[: 2 * most].split()))[:most] or type(error).__name__


def shown(value) -> str:
    """A value of a file as a sentence quotes it: at most 100 characters, in as little time.

    Three levels of it are looked at: a list that holds another one twice, which holds a third one
    twice, and so on, is too long to print as a whole.
    """
    try:
        return SHORT.repr(value)[:100]
    except ValueError:  # a number that has more digits than Python prints
        return f"one {type(value).__name__} that is too long to print"
