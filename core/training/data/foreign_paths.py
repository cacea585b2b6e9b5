"""Find the files that a data set names, even if paths are those of the machine that wrote it.

`find_files` does this for images and masks of every layout.  It tries, in this order:

1. the name as it is, relative to the data set's folder;
2. the name with the ending of an image added;
3. the files in the folder whose path has the longest tail in common with the name.  Of
   /home/x/data/images/2.jpeg it tries data/images/2, then images/2, then 2.  If the name's last
   folder (images) exists here, the file must be in a folder of that name.  Comparisons ignore case,
   Unicode's form and the image's ending; \\ counts as /; `file://`, %20, drives, `.` and `..` are
   resolved.  If several files have the same tail, the file at exactly this tail in the data set's
   folder wins, then the only one with the name's ending.  Otherwise the name is refused.

It searches only within the folder.  It takes no file of another split, and no mask or depth map
for a photograph.
"""

import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from unicodedata import normalize
from urllib.parse import unquote

from ...base.streams import printable
from .errors import DatasetError
from .photo_files import IMAGE_ENDINGS

MOST_ENTRIES = 300_000  # files and folders that are looked at; among more, no tails are sought
MOST_ALIKE = 8  # files with one tail that are kept: two are one too many
DEEPEST = 16  # folders of a tail
LONGEST_NAME = 80  # characters of a name in a message
SPLITS = {"train", "training", "val", "valid", "validation", "test", "testing", "eval"}
KINDS = ("mask", "depth", "normal", "segm", "semantic", "confidence", "thumb")
FAMILIES = {".jpeg": ".jpg", ".tiff": ".tif", ".heif": ".heic", ".hif": ".heic"}
DRIVE = re.compile(r"[A-Za-z]:$")


@dataclass(frozen=True)
class FoundFiles:
    """Files of a data set.

    Attributes:
        paths: One per name; None where there is none.
        said: A sentence about names that were not taken as they are, perhaps with an ending
            added; empty without any.
    """

    paths: list[Path | None]
    said: str


def find_files(folder: Path, names: list[str], source: Path, once=True) -> FoundFiles:
    """The files of names, by the rule above.

    Args:
        folder: The data set's.
        names: As they stand in `source`, from `folder` on.
        once: Two different names can't have one file.

    Raises:
        DatasetError: A name fits several files, or two names fit one.
    """
    paths, nearby, replaced = [], None, []
    for name in names:
        path = as_it_is(folder, name)
        if path is None:
            nearby = nearby or _Nearby(folder)
            path = nearby.like(name, source)
            if path and path.with_suffix("") != folder / name:
                replaced.append((name, path))
        paths.append(path)
    if once and replaced:
        _check_once(folder, names, paths, {name for name, _ in replaced}, source)
    return FoundFiles(paths, _said(folder, replaced, len(names), source))


def tried(name: str) -> str:
    """What `find_files` has tried for a name that no file has, for a message."""
    dirs, last = _parts(name)
    tails = ["/".join((*dirs[len(dirs) - k :], last)) for k in range(min(len(dirs), 2), -1, -1)]
    return (
        f"{tail_of(name)} (tried as it is, and {', '.join(map(tail_of, tails))} in the folder and "
        f"those within, in any case, with {', '.join(IMAGE_ENDINGS)})"
    )


def key_of(name: str) -> str:
    """A name for comparisons: equal for two spellings of one path, in one case."""
    dirs, last = _parts(name, _composed)
    return "/".join((*dirs, last))


def tail_of(name: str) -> str:
    """A name for a message, in one line; of a long one the end."""
    return printable(name if len(name) <= LONGEST_NAME else f"...{name[-LONGEST_NAME:]}")


def as_it_is(folder, name) -> Path | None:
    """The file of a name, or of the name with an image's ending; None without one."""
    path = os.path.join(folder, name)
    return next((Path(path + e) for e in ("", *IMAGE_ENDINGS) if os.path.isfile(path + e)), None)


def _composed(text):
    return normalize("NFC", text)


def _folded(text):
    return _composed(text).casefold()


def _parts(name, form=_folded):
    """The folders of a name and what stands behind them, in a form; the latter may be empty."""
    if name[:7].casefold() == "file://":
        name = unquote(name[7:])
    names = []
    for one in name.replace("\\", "/").split("/"):
        if one == "..":
            names = names[:-1]
        elif one not in ("", ".") and not DRIVE.match(one):
            names.append(form(one))
    return tuple(names[:-1][-DEEPEST:]), names[-1] if names else ""


def _divided(name):
    """A folded name without the ending of an image, and that; an empty one if it has none."""
    stem, dot, ending = name.rpartition(".")
    return (stem, dot + ending) if stem and dot + ending in IMAGE_ENDINGS else (name, "")


def _means(dirs):
    """The splits and the kinds of images that folders are called after."""
    kinds = {kind for kind in KINDS if any(kind in name for name in dirs)}
    return kinds | (SPLITS & {*dirs})


@dataclass(frozen=True)
class _Entry:
    """An image within the data set's folder: its folders and its ending are folded."""

    path: Path
    dirs: tuple[str, ...]
    ending: str
    linked: bool  # by a folder that is a link


@dataclass
class _Nearby:
    """All images within a folder, by the tails of their paths; it is looked through once."""

    folder: Path
    tails: dict[str, list[_Entry]] = field(default_factory=dict)
    folders: set[str] = field(default_factory=set)  # names, folded

    def __post_init__(self):
        waiting, count = [(self.folder, (), True)], 0
        while waiting:
            place, dirs, inner = waiting.pop()
            for entry in _entries(place):
                count += 1
                if count > MOST_ENTRIES:
                    self.tails.clear()  # what was not looked at may fit as well
                    return
                name = _folded(entry.name)
                if _holds(entry.is_dir):
                    self.folders.add(name)
                    if inner and len(dirs) < DEEPEST:  # a link's folders are not looked into
                        waiting.append((entry.path, (*dirs, name), not entry.is_symlink()))
                    continue
                stem, ending = _divided(name)
                if ending and _holds(entry.is_file):  # not a pipe, which would never answer
                    self._add(_Entry(Path(entry.path), dirs, ending, not inner), stem)

    def _add(self, entry, stem):
        for k in range(int(entry.linked), len(entry.dirs) + 1):  # a link has to be named
            alike = self.tails.setdefault("/".join((*entry.dirs[len(entry.dirs) - k :], stem)), [])
            if k == len(entry.dirs):
                alike.insert(0, entry)
            elif len(alike) < MOST_ALIKE:
                alike.append(entry)

    def like(self, name: str, source) -> Path | None:
        """The file that a name of another machine means; DatasetError if it may be several."""
        for spelled in [name, unquote(name)] if "%" in name else [name]:
            dirs, last = _parts(spelled)
            stem, ending = _divided(last)
            for k in range(len(dirs), -1, -1):
                if k == 0 and dirs and dirs[-1] in self.folders:
                    break
                alike = self.tails.get("/".join((*dirs[len(dirs) - k :], stem)), [])
                alike = [one for one in alike if _means(one.dirs) <= _means(dirs)]
                if alike:
                    return self._one_of(alike, k, ending, name, source)
        return None

    def _one_of(self, alike, k, ending, name, source):
        family = FAMILIES.get(ending, ending)
        for fits in (
            lambda one: len(one.dirs) == k,
            lambda one: one.ending == ending,
            lambda one: FAMILIES.get(one.ending, one.ending) == family,
        ):
            alike = list(filter(fits, alike)) or alike
        if len(alike) > 1 and len({os.path.realpath(one.path) for one in alike}) > 1:
            first, second, *_ = sorted(_within(self.folder, one.path) for one in alike)
            raise DatasetError(
                f"{source} names {tail_of(name)}, which may be {first} or {second} in "
                f"{self.folder}: name one of them there"
            )
        return alike[0].path


def _entries(place):
    """What a folder holds, in the order of the names, but what is hidden."""
    try:
        with os.scandir(place) as entries:
            found = [entry for entry in entries if not entry.name.startswith(".")]
    except OSError:  # it may not be read
        return []
    return sorted(found, key=lambda entry: entry.name)


def _holds(question) -> bool:
    """Whether an entry of a folder says so; a link to itself says nothing."""
    try:
        return question()
    except OSError:
        return False


def _check_once(folder, names, paths, replaced, source):
    """DatasetError if two different names have one file, and one of them isn't called so."""
    owners = {}
    for name, path in zip(names, paths, strict=True):
        if path is None:
            continue
        file = path.stat()
        other = owners.setdefault((file.st_dev, file.st_ino), name)
        if {name, other} & replaced and key_of(name) != key_of(other):
            raise DatasetError(
                f"{source} names {tail_of(other)} and {tail_of(name)}, and for both only "
                f"{_within(folder, path)} is in {folder}: keep the folders apart, as they were"
            )


def _said(folder, replaced, count, source):
    """A sentence about the names that other files stand in for."""
    if not replaced:
        return ""
    name, path = replaced[0]
    places = sorted({_within(folder, one.parent) for _, one in replaced})
    where = ", ".join(places[:3]) + (", ..." if len(places) > 3 else "")
    return (
        f"{len(replaced)} of {count} paths in {_within(folder, source)} do not exist: files of "
        f"{where} are read instead, first {_within(folder, path)} for {tail_of(name)}"
    )


def _within(folder, path) -> str:
    """A path in a folder, for a message; the folder itself is a dot."""
    return tail_of(os.path.relpath(path, folder))
