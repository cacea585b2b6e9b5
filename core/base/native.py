"""Kernels whose body is C++: read the source files and insert included files and values.

Warp pastes such a body into a function.  C++ allows no functions or templates there, so the sources
use lambdas.
"""

from pathlib import Path

LANES_H = Path(__file__).parent / "lanes.h"
MOST_LANES = 16  # of a vector, on any processor; rows of weights are a multiple of it


def native_source(path: Path, includes, values, section="") -> str:
    """The text of a file with others in it.

    Args:
        includes: Files that stand for the lines `#include "name"`.
        values: What stands for @NAME in all of them, by NAME.
        section: Leave out all but the head of the file and what is below the line `//# section`.
    """
    source = path.read_text(encoding="utf-8")
    if section:
        head, *sections = source.split("//# ")
        bodies = dict(text.split("\n", 1) for text in sections)
        source = head + bodies[section]
    for file in includes:
        line = f'#include "{file.name}"\n'
        source = source.replace(line, file.read_text(encoding="utf-8"))
    for name, value in values.items():
        source = source.replace(f"@{name}", str(value))
    return source
