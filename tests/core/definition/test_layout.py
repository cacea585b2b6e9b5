"""The definition imports NumPy alone, and stays short enough to be read."""

import ast
import sys
from pathlib import Path

import pytest

from deformrf.core import definition

FOLDER = Path(definition.__file__).parent
MODULES = sorted(FOLDER.glob("*.py"))
LINES_MAX = 1045
MORE = {"PIL", "..field", "..base"}  # of the program: a writer of images, the loader, files


def imported(path):
    """What a module imports, without Python's own library: "numpy", ".image", "..field"."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name.partition(".")[0] for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = ["." * node.level + (node.module or "").partition(".")[0]]
        else:
            continue
        yield from (name for name in names if name not in sys.stdlib_module_names)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_modules_import_numpy_and_each_other_alone(path):
    allowed = {"numpy", *("." + module.stem for module in MODULES)}
    if path.stem == "__main__":
        allowed |= MORE
    assert set(imported(path)) <= allowed


def test_the_program_takes_the_loader_alone_from_the_field():
    tree = ast.parse((FOLDER / "__main__.py").read_text(encoding="utf-8"))
    froms = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    taken = [alias.name for node in froms if node.level == 2 for alias in node.names]
    assert taken == ["forget_current_folder", "whole_file", "load"]


def test_it_is_read_in_an_hour():
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES)
    assert lines <= LINES_MAX, f"core/definition has {lines} lines"


def test_the_first_page_lists_all_modules_in_order_of_imports():
    """A module imports only what a reader has seen, but for contact, which the solver ends with."""
    listed = [line.split()[1] for line in definition.__doc__.splitlines() if line[:1].isdecimal()]
    assert sorted(listed) == [path.stem for path in MODULES if not path.stem.startswith("__")]
    for number, name in enumerate(listed):
        seen = {f".{other}" for other in listed[:number]} | {"numpy"}
        seen |= {".contact"} if name == "solver" else set()
        assert set(imported(FOLDER / f"{name}.py")) <= seen, name
