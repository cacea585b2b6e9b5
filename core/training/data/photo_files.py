"""Which files of a folder are photographs."""

import re
from pathlib import Path

from ...base.images import RAW_ENDINGS
from .errors import DatasetError

IMAGE_ENDINGS = (
    *(".png", ".webp", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"),
    *(".heic", ".heif", ".hif"),
)
MASK = "_mask"  # how the stem of a photograph's mask ends
MASKS = re.compile(r"masks?(-\d+)?", re.IGNORECASE)  # folders that hold masks


def photo_folder(folder: Path) -> Path | None:
    """The folder itself, or the one in it that holds photographs, not masks; None without any.

    Raises:
        DatasetError: Several folders in it hold photographs, or there are a camera's raw files
            instead of any.
    """
    folder = Path(folder)
    if photo_files(folder):
        return folder
    folders = [f for f in sorted(folder.iterdir()) if is_visible(f) and f.is_dir()]
    inner = [f for f in folders if not MASKS.fullmatch(f.name) and photo_files(f)]
    if len(inner) > 1:
        names = ", ".join(f.name for f in inner[:4])
        raise DatasetError(
            f"{len(inner)} folders in {folder} hold photographs ({names}): give one of them, or "
            f"put all photographs into one folder"
        )
    if not inner:
        for said in filter(None, map(about_raw_files, (folder, *folders))):
            raise DatasetError(said)
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


def about_raw_files(folder: Path) -> str:
    """A sentence about a camera's raw files that have no photograph of their name beside them.

    It is empty without any: most cameras that write both write them side by side.
    """
    stems = {f.stem for f in photo_files(folder)}
    raw = sorted(
        f.name
        for f in Path(folder).iterdir()
        if f.suffix.lower() in RAW_ENDINGS and f.stem not in stems and is_visible(f)
    )
    if not raw:
        return ""
    count = "1 raw file" if len(raw) == 1 else f"{len(raw)} raw files"
    return (
        f"{count} of a camera in {folder}, first {raw[0]}, can't be read: export JPEG or TIFF files"
    )


def is_visible(path: Path) -> bool:
    return not path.name.startswith(".")
