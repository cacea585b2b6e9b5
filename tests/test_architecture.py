"""ARCHITECTURE.md is true of the code: its tree exists, and its walks are calls."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
STATION = re.compile(r"^\d+\. `(?P<path>[\w/.]+\.py)` `(?P<name>[\w.]+)`", re.MULTILINE)
APP = (ROOT / "viewer" / "app.py").read_text(encoding="utf-8")
WALKS = re.split(r"^### ", TEXT, flags=re.MULTILINE)[1:]
MOST_STATIONS = 8


def stations(walk):
    """(path, qualified name) of each station of a walk."""
    return [(match["path"], match["name"]) for match in STATION.finditer(walk)]


def definition(path, name):
    """The syntax tree of a function, class or method by its qualified name."""
    node = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    for part in name.split("."):
        kinds = (ast.FunctionDef, ast.ClassDef)
        found = [n for n in ast.walk(node) if isinstance(n, kinds) and n.name == part]
        assert found, f"{path} has no {name}"
        node = found[0]
    return node


def used_in(node):
    """Names that a definition calls, or hands on to be called (kernels, callbacks)."""
    names = {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}
    return names | {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}


def reached_from(path, name):
    """Names that a station uses, itself or through other functions of its file."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    kinds = (ast.FunctionDef, ast.ClassDef)
    functions = {n.name: n for n in ast.walk(tree) if isinstance(n, kinds)}
    reached, waiting = set(), [definition(path, name)]
    while waiting:
        new = used_in(waiting.pop()) - reached
        reached |= new
        waiting += [functions[other] for other in new & functions.keys()]
    return reached


@pytest.mark.parametrize("walk", WALKS, ids=lambda walk: walk.splitlines()[0])
def test_a_walk_is_short_and_a_station_before_each_calls_it(walk):
    places = stations(walk)
    assert 2 <= len(places) <= MOST_STATIONS, places
    reached = reached_from(*places[0])
    for path, name in places[1:]:
        # A class is called by its name, one of its special methods by the class's.
        *owner, last = name.split(".")
        called = owner[-1] if last in ("__init__", "__call__") else last
        # The window calls the methods on_* of the handlers that the app gives it.
        given = last.startswith("on_") and "push_handlers(self.controls)" in APP
        assert given or called in reached, f"no station before it calls {path} {name}"
        reached |= reached_from(path, name)


def test_there_are_three_walks():
    assert len(WALKS) == 3


def test_the_tree_names_every_room():
    """Each line of the tree is a path that exists; no room is left out."""
    tree = re.search(r"```\n(.*?)```", TEXT, re.DOTALL)[1]
    parents, named = {}, set()
    for line in tree.splitlines():
        indent, name = re.match(r"( *)(\S+)", line).groups()
        depth = len(indent)
        path = parents.get(depth - 2, Path()) / name
        assert (ROOT / path).exists(), f"ARCHITECTURE.md names {path}"
        parents[depth] = path
        named.add(str(path))
    rooms = {
        str(init.parent.relative_to(ROOT))
        for part in ("core", "viewer")
        for init in (ROOT / part).rglob("__init__.py")
    }
    assert rooms <= named, f"ARCHITECTURE.md leaves out {sorted(rooms - named)}"
