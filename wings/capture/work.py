"""The work folder: results so far, while the cameras of photographs are being found.

It holds pycolmap's database, an .npz for each photograph (`Look`), and work.json, which lists the
photographs; a second database and second looks of the object alone, if mattes tell it from what
stands still.  A run that is interrupted leaves the folder.  One that ends removes the files that it
knows by name, and the folder if it is empty then; links and all other files stay.
"""

import json
import os
import re
import stat
import tempfile
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from ...core.base.archive import one_sentence, open_archive
from ...core.base.images import ImageError, open_image
from ...core.base.paths import whole_file
from .library import load_pycolmap
from .photos import Photo

LISTING = "work.json"
DATABASES = ("features.db", "object.db")  # of whole photographs, of the object alone
TEMPORARY = ".temporary-"
VERSION, KEYS = 3, {"version", "image_size", "photos", "masks", "program"}
LARGEST = 2**24  # bytes of a listing that is read: of a hundred thousand photographs
LOOK = r"\d{6,}(-object)?\.npz"
MATTE = r"\d{6,}(-made)?\.png"
# What paths.whole_file is writing.
PARTIAL = r"\.(work|\d{6,}(-object|-made)?)-[0-9a-f]{8}\.part\.(json|npz|png)"
OURS = re.compile(  # earlier versions wrote pairs.txt
    rf"work\.json|pairs\.txt|(features|object)\.db(-journal|-wal|-shm)?|{LOOK}|{MATTE}|{PARTIAL}"
)
TEMPORARY_FOLDER = re.compile(re.escape(TEMPORARY) + r"[a-z0-9_]{8}")
IN_IT = re.compile(
    r"\d{6,}(-mask)?\.png(\.png)?|(cameras|images|points3D|rigs|frames)\.(bin|txt)|project\.ini"
)


@dataclass(frozen=True)
class Look:
    """How a photograph looks.

    Attributes:
        colors: Of the pixel at each feature.  [m, 3] uint8
        sharpness: See `sharpness_of` in sharpness.py.
        exposure: Mean of the gray values, 0 to 1.
    """

    colors: np.ndarray
    sharpness: float
    exposure: float


@dataclass(frozen=True)
class Work:
    """A work folder, and the photographs that it is for.

    Attributes:
        folder: Where it is.
        photos: In the order of their numbers.
        image_size: Longer side that they are shrunk to [pixels].
        masks: The user's, one for each photograph, or none.
        program: What masking.digest_of says of the program that makes masks; "" without one.
        is_cut: Whether database and looks are those of the object alone.
    """

    folder: Path
    photos: tuple[Photo, ...]
    image_size: int
    masks: tuple[Path, ...] = ()
    program: str = ""
    is_cut: bool = False

    @property
    def has_masks(self) -> bool:
        """Whether masks are the user's, or made by a program of the user's."""
        return bool(self.masks or self.program)

    @property
    def database_path(self) -> Path:
        return self.folder / DATABASES[self.is_cut]

    def database(self):
        """pycolmap's database, open; a context manager."""
        return load_pycolmap().Database.open(str(self.database_path))

    def look_path(self, number: int) -> Path:
        return self.folder / f"{name_of(number)}{'-object' if self.is_cut else ''}.npz"

    def matte_path(self, number: int, made: bool = False) -> Path:
        return self.folder / f"{name_of(number)}{'-made' if made else ''}.png"

    def matte(self, number: int, made: bool = False) -> np.ndarray | None:
        """A photograph's matte, see mattes.py; None without one.  [h, w] uint8

        Args:
            made: By the program; else by the ring that the photograph is in.
        """
        try:
            with open_image(self.matte_path(number, made)) as image:
                return np.asarray(image.convert("L"))
        except ImageError:
            return None

    def keep_matte(self, number: int, matte: np.ndarray, made: bool = False):
        with whole_file(self.matte_path(number, made)) as partial:
            Image.fromarray(matte).save(partial)

    def has_look(self, number: int) -> bool:
        """Whether there is a look that can be read."""
        try:
            self.look(number)
        except ValueError:
            return False
        return True

    def look(self, number: int) -> Look:
        """Raises a ValueError if the file is missing or damaged."""
        path = self.look_path(number)
        with one_sentence(path), open_archive(path, "look") as file:
            colors, numbers = np.asarray(file["colors"]), ("sharpness", "exposure")
            if colors.dtype != np.uint8 or colors.shape != (len(colors), 3):
                raise ValueError(f"its colors are {colors.dtype} of {list(colors.shape)}")
            return Look(colors, *(float(np.asarray(file[name])) for name in numbers))

    def keep_look(self, number: int, look: Look):
        with whole_file(self.look_path(number)) as partial:
            np.savez(partial, **vars(look))

    def is_whole(self) -> bool:
        """Whether the databases are not damaged; there may be none yet."""
        import sqlite3  # late: a viewer asks no database

        try:
            for path in filter(Path.exists, (self.folder / name for name in DATABASES)):
                with closing(sqlite3.connect(path)) as database:
                    if database.execute("PRAGMA quick_check").fetchall() != [("ok",)]:
                        return False
        except sqlite3.Error:
            return False
        return True

    def temporary_folder(self):
        """A folder in it for what pycolmap reads and writes; a context manager."""
        return tempfile.TemporaryDirectory(prefix=TEMPORARY, dir=self.folder)

    def remove(self) -> bool:
        """Remove our files, and the folder if it is empty then; returns whether it is gone."""
        with suppress(OSError):
            # The listing goes last, or nobody would know again whose the others are.
            for path in sorted(self.folder.iterdir(), key=lambda path: path.name == LISTING):
                if OURS.fullmatch(path.name) and is_file(path):
                    path.unlink()
                elif TEMPORARY_FOLDER.fullmatch(path.name) and is_folder(path):
                    with suppress(OSError):  # what is in it is not all known
                        remove_temporary(path)
            self.folder.rmdir()
        return not self.folder.exists()


def name_of(number: int) -> str:
    """A photograph's name in the database; its own may have spaces."""
    return f"{number:06d}"


def number_of(name: str) -> int:
    return int(Path(name).stem)


def remove_temporary(folder: Path):
    """Remove a temporary folder of a run that was killed.

    Raises:
        OSError: Something else is in it.
    """
    for path in folder.iterdir():
        if path.name.isdecimal() and is_folder(path):  # a group that pycolmap wrote
            remove_temporary(path)
        elif IN_IT.fullmatch(path.name) and is_file(path):
            path.unlink()
    folder.rmdir()


def is_file(path: Path) -> bool:
    """Whether it is a file, and no link to one."""
    return stat.S_ISREG(path.lstat().st_mode)


def is_folder(path: Path) -> bool:
    return stat.S_ISDIR(path.lstat().st_mode)


def open_work(
    folder: Path, photos, image_size: int, masks=(), program: str = ""
) -> tuple[Work, bool]:
    """A work folder for photographs and masks, and whether it holds work on exactly these.

    It is `folder`, or <folder>-2 and so on where something else is there.  Work on other
    photographs is removed, and damaged work.

    Raises:
        OSError: The folder can't be made.
    """
    work = Work(Path(folder), tuple(photos), image_size, tuple(masks), program)
    wanted, there, number = listing(work), [], 1
    while os.path.lexists(work.folder):
        there.append((work, held(work.folder)))
        number += 1
        work = replace(work, folder=Path(f"{folder}-{number}"))
    for known, found in there:
        if found == wanted and known.is_whole():
            return known, True
    for known, found in there:
        if found is not None and known.remove():
            work = known
            break
    work.folder.mkdir(parents=True)
    with whole_file(work.folder / LISTING) as partial:
        partial.write_text(json.dumps(wanted), encoding="utf-8")
    return work, False


def remove_left(folder: Path, data: Path) -> None:
    """Remove work on photographs of `data`, whose cameras are known: a run was killed so late."""
    inner, known = data.resolve(), held(folder)
    if known:
        with suppress(LookupError, TypeError, ValueError):  # the listing may be damaged
            if all(Path(name).is_relative_to(inner) for name, *_ in known["photos"]):
                Work(folder, (), 0).remove()


def held(folder: Path) -> dict | None:
    """What a work folder's listing says; None of anything else.

    {} if there is nothing yet: an empty folder, or one that a run was killed in at its beginning.
    """
    try:
        if not is_folder(folder):
            return None
        files = list(folder.iterdir())
        if all(re.fullmatch(PARTIAL, file.name) and is_file(file) for file in files):
            return {}
        path = folder / LISTING
        ours = [file for file in files if OURS.fullmatch(file.name)]
        if path not in ours or not all(map(is_file, ours)) or path.stat().st_size > LARGEST:
            return None
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(found, dict) or found.keys() != KEYS:
        return None
    return found if type(found["version"]) is int and found["version"] == VERSION else None


def listing(work: Work) -> dict:
    """What work.json holds."""

    def known(paths):
        files = [(str(path.resolve()), path.stat()) for path in paths]
        return [[path, stat.st_size, stat.st_mtime_ns] for path, stat in files]

    return {
        "version": VERSION,
        "image_size": work.image_size,
        "photos": known(photo.path for photo in work.photos),
        "masks": known(work.masks),
        "program": work.program,
    }
