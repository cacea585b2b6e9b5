"""The work folder: what is known so far of photographs whose cameras are being found.

It holds pycolmap's database, for each photograph an .npz (`Look`), and work.json, which says for
which photographs all this is.  A run that is interrupted leaves it; one that ends removes it.
"""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..paths import whole_file
from .library import load_pycolmap
from .photos import CaptureError, Photo

LISTING, DATABASE = "work.json", "features.db"
VERSION = 1


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
    """

    folder: Path
    photos: tuple[Photo, ...]
    image_size: int

    @property
    def database_path(self) -> Path:
        return self.folder / DATABASE

    def database(self):
        """pycolmap's database, open; a context manager."""
        return load_pycolmap().Database.open(str(self.database_path))

    def look_path(self, number: int) -> Path:
        return self.folder / f"{name_of(number)}.npz"

    def has_look(self, number: int) -> bool:
        return self.look_path(number).is_file()

    def look(self, number: int) -> Look:
        with np.load(self.look_path(number), allow_pickle=False) as file:
            return Look(file["colors"], float(file["sharpness"]), float(file["exposure"]))

    def keep_look(self, number: int, look: Look):
        with whole_file(self.look_path(number)) as partial:
            np.savez(partial, **vars(look))

    def remove(self):
        shutil.rmtree(self.folder, ignore_errors=True)


def name_of(number: int) -> str:
    """A photograph's name in the database; its own may have spaces."""
    return f"{number:06d}"


def number_of(name: str) -> int:
    return int(Path(name).stem)


def open_work(folder: Path, photos, image_size: int) -> tuple[Work, bool]:
    """The work folder for photographs, and whether it holds work on exactly these.

    Work on other photographs is removed.

    Raises:
        CaptureError: Something else is in the folder.
    """
    work = Work(Path(folder), tuple(photos), image_size)
    wanted = listing(work)
    if work.folder.exists():
        known = None
        if (path := work.folder / LISTING).is_file():
            try:
                known = json.loads(path.read_text(encoding="utf-8"))
            except ValueError:
                known = {}
        elif not work.folder.is_dir() or any(work.folder.iterdir()):
            raise CaptureError(
                f"{work.folder} is needed for unfinished work, but something else is there: "
                f"rename it, or the model"
            )
        if known == wanted:
            return work, True
        shutil.rmtree(work.folder)
    work.folder.mkdir(parents=True)
    with whole_file(work.folder / LISTING) as partial:
        partial.write_text(json.dumps(wanted), encoding="utf-8")
    return work, False


def listing(work: Work) -> dict:
    """What work.json holds."""
    files = [(str(p.path.resolve()), p.path.stat()) for p in work.photos]
    return {
        "version": VERSION,
        "image_size": work.image_size,
        "photos": [[path, stat.st_size, stat.st_mtime_ns] for path, stat in files],
    }
