"""The text of cpu.cpp and cuda.cu as Warp takes it."""

from pathlib import Path

from ..constraints import COLLAPSED, STEP_LIMIT

FOLDER = Path(__file__).parent
SHARED = "substep.h"


def native_source(name: str, **values) -> str:
    """A file's text with substep.h in its place and a value for each @NAME."""
    text = (FOLDER / name).read_text(encoding="utf-8")
    shared = (FOLDER / SHARED).read_text(encoding="utf-8")
    text = text.replace(f'#include "{SHARED}"\n', shared)
    values |= {"COLLAPSED": f"{COLLAPSED}f", "STEP_LIMIT": f"{STEP_LIMIT}f"}
    for key, value in values.items():
        text = text.replace(f"@{key}", str(value))
    return text
