"""mypy and editors know the API: each name of docs/api.md, what it takes and what it returns."""

import ast
import importlib
import inspect
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PROGRAMS = ROOT / "tests" / "typing"
PAGE = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
TABLE = {
    door: re.findall(r"`(\w+)`", names)
    for door, names in re.findall(r"^\| `(deformrf[\w.]*)` \| (.*) \|$", PAGE, re.MULTILINE)
}
WINGS = "deformrf.wings.rig", "deformrf.wings.capture"  # typed to the last name
# What the annotations leave open: shapes and elements of arrays, JSON, fields by name.
LEFT_OPEN = (
    r"ndarray\[tuple\[Any, \.\.\.\]|dtype\[Any\]|array\[Any, int\]|dict\[str, Any\]|\*\*\w+: Any"
)


def members(cls):
    """The public attributes of a class, and of its instances as `__init__` sets them."""
    names = {*vars(cls), *vars(cls).get("__annotations__", ())}
    if inspect.isfunction(cls.__init__) and "__dataclass_fields__" not in vars(cls):
        for node in ast.walk(ast.parse(textwrap.dedent(inspect.getsource(cls.__init__)))):
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                names.add(node.attr)
    return sorted(name for name in names if not name.startswith("_"))


def questions():
    """A program that asks mypy for the type of each public name and member, one a line."""
    doors = {door: importlib.import_module(door) for door in TABLE}
    lines = [f"import {door}" for door in doors]
    for door, module in doors.items():
        for name in module.__all__ if door in WINGS else TABLE[door]:
            path, value = f"{door}.{name}", getattr(module, name)
            lines.append(f"reveal_type({path})")
            if inspect.isclass(value):
                lines += [
                    f"def _{len(lines)}_{i}(x: {path}) -> None: reveal_type(x.{member})"
                    for i, member in enumerate(members(value))
                ]
    return "\n".join(lines)


@pytest.fixture(scope="module")
def checked(pytestconfig, tmp_path_factory):
    """What mypy says, in one run, of each program: its lines, and {(line number, sentence)}."""
    folder = tmp_path_factory.mktemp("programs")
    programs = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)  # each goes on from the last
    (folder / "page.py").write_text("".join(programs), encoding="utf-8")
    (folder / "questions.py").write_text(questions(), encoding="utf-8")
    paths = [*PROGRAMS.glob("*.py"), *folder.glob("*.py")]
    cache = pytestconfig.cache.mkdir("mypy")
    link = cache / "deformrf"  # mypy finds a package by its folder's name
    link.unlink(missing_ok=True)
    link.symlink_to(ROOT)
    arguments = ["--cache-dir", cache / "cache", "--config-file", ROOT / "pyproject.toml"]
    run = subprocess.run(
        [sys.executable, "-m", "mypy", *map(str, arguments), *map(str, paths)],
        env=os.environ | {"MYPYPATH": str(cache)},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 1, run.stdout + run.stderr  # tests/typing/mistakes.py has errors
    found = {path.stem: (path.read_text(encoding="utf-8").splitlines(), set()) for path in paths}
    for name, line, sentence in re.findall(r"(\w+)\.py:(\d+): (.*)", run.stdout):
        found[name][1].add((int(line), sentence))
    return found


@pytest.mark.parametrize("door", TABLE)
def test_a_door_begins_with_the_names_of_the_page(door):
    stub = ROOT.joinpath(*door.split(".")[1:], "__init__.pyi").read_text(encoding="utf-8")
    first = stub.partition("\n# ")[0]
    assert sorted(TABLE[door]) == sorted(re.findall(r" as (\w+)", first))


def test_the_caller_uses_every_name_of_the_page():
    used = set()
    for node in ast.walk(ast.parse((PROGRAMS / "caller.py").read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("deformrf"):
            used |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "deformrf":
            used.add(ast.unparse(node))
    used.remove("deformrf.__version__")
    assert {f"{door}.{name}" for door, names in TABLE.items() for name in names} == used


@pytest.mark.parametrize("program", ["page", "caller"])
def test_a_right_program_has_no_errors(checked, program):
    assert not checked[program][1]


def test_each_mistake_is_found(checked):
    lines, found = checked["mistakes"]
    expected = {(i, line.split("  # ")[1]) for i, line in enumerate(lines, 1) if "  # " in line}
    errors = {(i, text.rpartition("[")[2][:-1]) for i, text in found if text.startswith("error")}
    assert errors == expected


def test_no_public_name_is_unknown(checked):
    lines, found = checked["questions"]
    types = dict(found)
    for number, line in enumerate(lines, 1):
        if "reveal_type" in line:
            answer = types.get(number, "no answer")
            assert answer.startswith("note: Revealed type is "), f"{line}: {answer}"
            assert not re.search(r"\bAny\b", re.sub(LEFT_OPEN, "", answer)), f"{line}: {answer}"


def test_the_package_says_that_it_is_typed():
    """The marker of PEP 561; without it mypy takes the names of an installed package for Any."""
    assert (ROOT / "py.typed").exists()
