"""A kind whose mutants are folders of files, of which one or two are damaged.

The content of a file is what it is made of, so that its damage knows structure: a dict or a list
is JSON, a str is text, Arrays are those of an .npz, a Binary has counts and parts, bytes are bytes.
"""

import json
import os
from pathlib import Path

from .damage import Binary, json_bytes, packed, with_bytes, with_structure, with_text
from .zips import with_zip


class Arrays(dict):
    """The arrays of an .npz, by name."""


def content_bytes(content) -> bytes:
    """A file's content as it is undamaged."""
    if isinstance(content, Arrays):
        return packed(_Even(), content)
    if isinstance(content, Binary):
        return content.data
    if isinstance(content, dict | list):
        return json.dumps(content).encode()
    return content.encode() if isinstance(content, str) else content


class _Even:
    """Compresses nothing."""

    def random(self):
        return 1.0


def damaged(rng, content, other: bytes) -> tuple[bytes, str]:
    """A file's content with damage of its kind.

    Args:
        other: Another file, of which a part may follow.
    """
    if isinstance(content, Arrays):
        return with_zip(rng, content_bytes(content), content)
    if isinstance(content, Binary):
        return with_structure(rng, content, other)
    if isinstance(content, dict | list):
        return json_bytes(rng, content)
    if isinstance(content, str):
        return with_text(rng, content)
    if rng.random() < 0.7:
        return with_bytes(rng, content), "bytes"
    return with_structure(rng, Binary(content, (), tuple(range(0, len(content), 64))), other)


class Tree:
    """Folders that are read; a kind has `errors`, `variants` and `read`.

    Attributes:
        errors: What reading may raise.
        variants: Undamaged folders: dicts of content by path.
        often: Paths that are damaged more often than others: parts of their names.
    """

    errors: tuple = ()
    often: tuple = ()

    def __init__(self, folder: Path):
        self.variants: list[dict] = []

    def read(self, folder: Path):
        raise NotImplementedError

    def original(self, folder: Path):
        self.write(folder, self.variants[0])

    def mutate(self, rng, folder: Path) -> str:
        files = dict(self.variants[rng.integers(len(self.variants))])
        what = []
        for _ in range(1 if rng.random() < 0.8 else 2):
            names = [n for n in files if not self.often or any(o in n for o in self.often)]
            if not names or rng.random() < 0.3:
                names = list(files)
            name = names[rng.integers(len(names))]
            if rng.random() < 0.9:
                other = content_bytes(files[list(files)[rng.integers(len(files))]])
                files[name], done = damaged(rng, files[name], other)
                what.append(f"{name}: {done}")
        self.write(folder, files)
        if not what:
            name = list(files)[rng.integers(len(files))]
            what.append(f"{name}: {_misplaced(rng, folder, name)}")
        return "; ".join(what)

    def write(self, folder: Path, files: dict):
        for name, content in files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content_bytes(content))


def _misplaced(rng, folder: Path, name: str) -> str:
    """Something else is where a file was."""
    path, kind = folder / name, int(rng.integers(9))
    if kind == 0:
        path.unlink()
        path.mkdir()
        return "a folder"
    if kind == 1:
        path.unlink()
        os.mkfifo(path)
        return "a FIFO"
    if kind == 2:
        path.unlink()
        path.symlink_to(path.name)
        return "a link to itself"
    if kind == 3:
        path.unlink()
        path.symlink_to(
            ["/dev/zero", "/dev/null", "/etc/passwd", "/proc/self/environ"][rng.integers(4)]
        )
        return "a link out of the folder"
    if kind == 4:
        path.rename(path.with_suffix(path.suffix.upper()))
        return "an upper-case ending"
    if kind == 5:
        path.write_bytes(b"")
        return "empty"
    if kind == 6:
        path.rename(path.with_name("ä \x1b[2J\n" + path.name))
        return "another name"
    if kind == 7:
        with open(path, "ab") as file:
            file.truncate(70 * 2**20)  # it takes no room on the disk
        return "70 MB of zeros behind it"
    path.unlink()
    return "missing"
