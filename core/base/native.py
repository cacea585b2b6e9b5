"""Kernels whose body is C++: texts that include each other, with values in their places.

Warp compiles such a body inside of a function, so the texts have lambdas in place of functions
and templates.
"""

from pathlib import Path

LANES_H = Path(__file__).parent / "lanes.h"
MOST_LANES = 16  # of a vector, on any processor; rows of weights are a multiple of it


def native_source(path: Path, includes=(), values=None) -> str:
    """The text of a file with others in it.

    Args:
        includes: Files that stand for the lines `#include "name"`.
        values: What stands for @NAME in all of them, by NAME.
    """
    source = path.read_text(encoding="utf-8")
    for file in includes:
        line = f'#include "{file.name}"\n'
        source = source.replace(line, file.read_text(encoding="utf-8"))
    for name, value in (values or {}).items():
        source = source.replace(f"@{name}", str(value))
    return source
