"""Which files of a folder are photographs."""

import re
from pathlib import Path

from .errors import DatasetError

IMAGE_ENDINGS = (".png", ".webp", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".heic", ".heif")
MASK = "_mask"  # how the stem of a photograph's mask ends
MASKS = re.compile(r"masks?(-\d+)?", re.IGNORECASE)  # folders that hold masks


def photo_folder(folder: Path) -> Path | None:
    """The folder itself, or the one in it that holds photographs, not masks; None without any.

    Raises:
        DatasetError: Several folders in it hold photographs.
    """
    folder = Path(folder)
    if photo_files(folder):
        return folder
    inner = [f for f in sorted(folder.iterdir()) if is_visible(f) and f.is_dir()]
    inner = [f for f in inner if not MASKS.fullmatch(f.name) and photo_files(f)]
    if len(inner) > 1:
        names = ", ".join(f.name for f in inner[:4])
        raise DatasetError(
            f"{len(inner)} folders in {folder} hold photographs ({names}): give one of them, or "
            f"put all photographs into one folder"
        )
    return inner[0] if inner else None


def photo_files(folder: Path) -> list[Path]:
    """Files whose names are those of photographs, and not of masks of them, by name."""
    found = [
        f for f in Path(folder).iterdir() if f.suffix.lower() in IMAGE_ENDINGS and is_visible(f)
    ]
    stems = {f.stem for f in found}
    return sorted(
        f
        for f in found
        if f.is_file() and not (f.stem.endswith(MASK) and f.stem.removesuffix(MASK) in stems)
    )


def is_visible(path: Path) -> bool:
    return not path.name.startswith(".")
