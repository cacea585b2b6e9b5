"""The repository's shape: who may import whom, what is installed, and under which name."""

import ast
import importlib
import re
import subprocess
import symtable
import sys
import tomllib
from functools import cache
from itertools import chain
from pathlib import Path

import narrow
import pytest

ROOT = Path(__file__).resolve().parent.parent
ROOMS = "core", "wings", "commands", "viewer"
SOURCES = sorted(p for folder in ROOMS for p in (ROOT / folder).rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))

# Each may import itself and those named on its right; the longest name that fits a module counts.
MAY_IMPORT = {
    "core.definition": [],
    "core.definition.__main__": ["core"],
    "core.base": [],
    "core.geometry": ["core.base", "core.definition"],
    "core.field": ["core.base", "core.definition", "core.geometry"],
    "core.render": ["core.base", "core.definition", "core.geometry", "core.field"],
    "core.deform": ["core.base", "core.definition", "core.geometry"],
    "core.training": [
        "core.base",
        "core.definition",
        "core.geometry",
        "core.field",
        "core.render",
    ],
    "core.model": ["core"],
    "wings.rig": ["core"],
    "wings.capture": ["core"],
    "wings.lab": ["core"],
    "commands": ["core", "wings", "viewer"],
    "viewer": ["core", "wings"],
    "viewer.__main__": ["core", "commands"],
    "viewer.camera": ["core"],
    "viewer.document": ["core", "wings", "viewer.settings", "viewer.camera"],
    "viewer.document.history": ["core"],
    "viewer.document.timeline": ["core", "wings", "viewer.document.history", "viewer.camera"],
    "viewer.document.rigging": ["core", "wings", "viewer.document.history"],
    "viewer.document.scene": [
        "core",
        "viewer.settings",
        "viewer.camera",
        "viewer.document.history",
        "viewer.document.timeline",
        "viewer.document.rigging",
    ],
    "viewer.files": ["core", "wings", "viewer.logs", "viewer.camera", "viewer.document"],
    "viewer.layers": [
        "core",
        "viewer.settings",
        "viewer.camera",
        "viewer.document",
        "viewer.files",
    ],
    "viewer.tools": [
        "core",
        "wings",
        "viewer.settings",
        "viewer.camera",
        "viewer.document",
        "viewer.files",
    ],
}
WINDOWING = ["moderngl", "pyglet", "imgui_bundle"]  # in viewer alone
SLOW = {
    "torch",
    "warp",
    "pyglet",
    "scipy",
    "matplotlib",
    "markdown_it",
}  # imported when used: --help has to answer at once
FUNCTION_LINES_MAX = 60
NARROW = "viewer/document", "viewer/layers"  # whose parts see each other by protocols
WHOLE_SCENE = {  # what really is about all of it
    "sessions/player.py": ["__init__"],
}


def module_name(path):
    """core/field/encoding.py -> deformrf.core.field.encoding"""
    return ".".join(["deformrf", *path.relative_to(ROOT).with_suffix("").parts])


@cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def is_within(module, *packages):
    return any(f"{module}.".startswith(f"{package}.") for package in packages)


def imported_modules(path):
    """Yield the full name of everything that a file imports."""
    package = module_name(path).split(".")[:-1]
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            for alias in node.names:
                yield ".".join([*base, *filter(None, [node.module]), alias.name])


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_imports_follow_the_layers(path):
    here = module_name(path)
    room = max((p for p in MAY_IMPORT if is_within(here, f"deformrf.{p}")), key=len, default=None)
    names = [here] if room is None else [f"deformrf.{p}" for p in [room, *MAY_IMPORT[room]]]
    for module in imported_modules(path):
        assert not is_within(module, *ROOMS), f"{module}: write deformrf.{module}"
        if is_within(module, "deformrf"):
            assert is_within(module, *names), f"{here} may not import {module}"
        if not is_within(here, "deformrf.viewer"):
            assert not is_within(module, *WINDOWING), f"{here} may not import {module}"


def is_module(name):
    """Whether deformrf.a.b is a module or a folder of modules in the tree."""
    path = ROOT.joinpath(*name.split(".")[1:])
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def door_before(target):
    """The outermost room with a door that a module lies in; None if there is none.

    >>> door_before("deformrf.core.render.rays.camera")
    'deformrf.core.render'
    """
    names = target.split(".")
    rooms = (names[: n + 1] for n in range(1, len(names)))
    return next(
        (".".join(r) for r in rooms if ROOT.joinpath(*r[1:], "__init__.pyi").exists()), None
    )


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_rooms_are_entered_by_their_doors(path):
    """Only the lab reaches in: it measures what lies behind."""
    here = module_name(path).removesuffix(".__init__")
    if is_within(here, "deformrf.wings.lab"):
        return
    for name in imported_modules(path):
        target = name if is_module(name) else name.rpartition(".")[0]
        door = door_before(target) if is_within(target, "deformrf") else None
        if door not in (None, target) and not is_within(here, door):
            raise AssertionError(f"{here} imports {target}: {door} should have the name")


@cache
def names_of(module):
    """What deformrf.a.b defines or imports, by its stub if it has one."""
    path = ROOT.joinpath(*module.split(".")[1:])
    files = path.with_suffix(".py"), path / "__init__.pyi", path / "__init__.py"
    file = next((file for file in files if file.exists()), None)
    if file is None:
        return frozenset()
    table = symtable.symtable(file.read_text(encoding="utf-8"), str(file), "exec")
    return {s.get_name() for s in table.get_symbols() if s.is_assigned() or s.is_imported()}


@pytest.mark.parametrize("path", TESTS, ids=module_name)
def test_tests_and_benchmarks_import_what_exists_through_doors(path):
    """Where a door has a name, it is taken from there.  Files are read, not run."""
    for node in ast.walk(tree_of(path)):
        if not isinstance(node, ast.ImportFrom) or not is_within(node.module, "deformrf"):
            continue
        module, door = node.module, door_before(node.module)
        for name in (alias.name for alias in node.names):
            assert is_module(f"{module}.{name}") or name in names_of(module), f"{module}: no {name}"
            if door not in (None, module):
                assert name not in names_of(door), f"{name} of {module}: take it from {door}"


@pytest.mark.parametrize("package", [m for m in map(module_name, SOURCES) if "__init__" in m])
def test_doors_open(package):
    """Every name that a door promises is there."""
    import pyglet

    pyglet.options.headless = True  # modules of windows can be imported without a display
    door = importlib.import_module(package.removesuffix(".__init__"))
    for name in getattr(door, "__all__", ()):
        assert hasattr(door, name), f"{package} has no {name}"


@cache
def narrow_rooms():
    paths = [path for path in SOURCES if str(path.relative_to(ROOT)).startswith(NARROW)]
    return narrow.Rooms({path: tree_of(path) for path in paths})


def test_parts_take_what_their_protocols_have():
    assert not narrow_rooms().faults, "\n".join(narrow_rooms().faults)


def test_protocols_are_narrow():
    assert not narrow_rooms().idle, "nobody takes them"
    assert not narrow_rooms().wide, "a part is seen by a protocol, too"


def test_few_functions_take_the_whole_scene():
    found = {}
    for path, tree in narrow_rooms().trees.items():
        for _, function in narrow.functions(tree):
            for one in narrow.parameters(function):
                if one.arg in ("scene", "app") or {"Scene", "App"} & {
                    *narrow.names_in(one.annotation)
                }:
                    found.setdefault("/".join(path.parts[-2:]), []).append(function.name)
    assert found == WHOLE_SCENE


def test_the_scene_is_given_to_protocols_alone():
    rooms = narrow_rooms()
    for node in ast.walk(tree_of(ROOT / "viewer" / "document" / "scene" / "scene.py")):
        if isinstance(node, ast.Call):
            for one in (one for one in node.args if ast.unparse(one) == "self"):
                assert rooms.wanted(node, one), ast.unparse(node)


USER = """
class Inner(Protocol):
    seen: int

class Outer(Protocol):
    inner: Inner
    def go(self): ...

class More(Outer, Protocol):
    count: int

def glance(inner: Inner):
    return inner.seen

class User:
    def __init__(self, more: More):
        self._more = more
    def use(self):
        more, count = self._more, self._more.count
        more.go()
        glance(more.inner)
        {}
"""


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("return more.inner is None", ""),
        ("more.stop()", "more.stop is not in More"),
        ("more.stopped = True", "more.stopped is not in More"),
        ("self._more.inner.hidden += 1", "self._more.inner.hidden is not in Inner"),
        ("inner, _ = more.inner, 1; return lambda: inner.hidden", "inner.hidden is not in Inner"),
        ("getattr(more, 'stop')", "more is lost sight of"),
        ("glance(more)", "more is lost sight of"),  # which has nothing that is seen
        ("self.more = more", "more is lost sight of"),  # others could take it from there
        ("return [self._more]", "self._more is lost sight of"),
    ],
)
def test_what_a_protocol_lacks_is_found(line, fault):
    found = narrow.Rooms({"user": ast.parse(USER.format(line))}).faults
    assert [one.partition(": ")[2] for one in found] == ([fault] if fault else [])


def test_what_a_real_protocol_lacks_is_found():
    trees = dict(narrow_rooms().trees)
    path = ROOT / "viewer" / "document" / "timeline" / "timeline.py"
    text = path.read_text(encoding="utf-8").replace("_keyed.clock.paused", "_keyed.ball")
    assert "_keyed.ball" in text
    found = narrow.Rooms(trees | {path: ast.parse(text)}).faults
    assert found and all(one.endswith("self._keyed.ball is not in Keyed") for one in found)


def test_what_is_superfluous_in_a_protocol_is_found():
    user = USER.format("return").replace("    seen: int", "    seen: int\n    user: User")
    rooms = narrow.Rooms({"user": ast.parse(user)})
    assert rooms.idle == rooms.wide == [("Inner", "user")]


def lines_of(function):
    """Those of a function's code, without its docstring."""
    first = function.body[0]
    has_text = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    text = first.end_lineno - first.lineno + 1 if has_text else 0
    return function.end_lineno - function.lineno + 1 - text


def runs_on_a_device(function):
    """Whether Warp or Triton compiles it: what it calls would be inlined again."""
    names = {ast.unparse(d).split("(")[0] for d in function.decorator_list}
    return bool(names & {"wp.kernel", "wp.func", "triton.jit"})


@pytest.mark.parametrize("path", SOURCES + TESTS, ids=module_name)
def test_functions_stay_short(path):
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.FunctionDef) and not runs_on_a_device(node):
            count = lines_of(node)
            place = f"{path.relative_to(ROOT)}: {node.name}"
            assert count <= FUNCTION_LINES_MAX, f"{place} has {count} lines of code: divide it"


def test_no_two_classes_have_one_name():
    places = {}
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(module_name(path))
    twice = {name: found for name, found in places.items() if len(found) > 1}
    assert not twice, twice


def logic(path):
    """(number, text) of the lines that hold logic: no imports, docstrings, heads, names alone."""
    text, passed = path.read_text(encoding="utf-8"), set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
            passed.update(range(first, node.body[0].lineno))
        is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if is_text or isinstance(node, ast.Import | ast.ImportFrom):
            passed.update(range(node.lineno, node.end_lineno + 1))
    lines = ((n, line.strip()) for n, line in enumerate(text.splitlines(), 1) if n not in passed)
    return [(n, line) for n, line in lines if not re.fullmatch(r"[\W\d_]*|#.*|[\w.]+,", line)]


def test_no_six_lines_of_logic_stand_twice():
    seen, twice = {}, {}
    for path in SOURCES:
        lines, name = logic(path), str(path.relative_to(ROOT))
        for six in zip(*(lines[k:] for k in range(6)), strict=False):
            text = "\n".join(line for _, line in six)
            if text in seen:
                twice[seen[text][0], name] = f"{seen[text]}, {name} {six[0][0]}:\n{text}"
            seen.setdefault(text, (name, six[0][0]))
    assert not twice, "\n\n".join(twice.values())


def test_every_package_is_installed():
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    folders = {p.parent for p in SOURCES}
    without_init = {str(f) for f in folders if not (f / "__init__.py").exists()}
    assert not without_init, "a folder of modules needs an __init__.py to be installed"
    found = {"deformrf", *map(module_name, folders)}
    assert set(setuptools["packages"]) == found | {"deformrf.shaders", "deformrf.assets"}


def test_everything_beside_modules_is_installed():
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    data = setuptools["package-data"]
    for path in (path for room in ROOMS for path in (ROOT / room).rglob("*")):
        if path.is_file() and path.suffix not in (".py", ".pyc"):
            patterns = data["*"] + data.get(module_name(path.parent), [])
            assert any(path.match(pattern) for pattern in patterns), f"{path} isn't installed"


def test_every_dependency_is_pinned():
    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = {
        canonicalize_name(line.split("==")[0]): line.split("==")[1]
        for line in lines
        if "==" in line
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *chain(*project["optional-dependencies"].values())]
    for requirement in map(Requirement, wanted):
        if requirement.name == project["name"]:  # "all" is the sum of other extras
            continue
        pin = pins.get(canonicalize_name(requirement.name))
        assert pin, f"constraints.txt lacks {requirement.name}"
        assert pin in requirement.specifier, f"constraints.txt has {pin}, wanted {requirement}"


@pytest.mark.parametrize(
    "module",
    [
        "deformrf.commands.training",
        "deformrf.commands.data",
        "deformrf.commands.doctor",
        "deformrf.commands.edit",
        "deformrf.commands.evaluate",
        "deformrf.commands.render",
        "deformrf.commands.rig",
        "deformrf.commands.report",
        "deformrf.commands.view",
        "deformrf.commands.train",
    ],
)
def test_entry_points_import_nothing_slow(module):
    program = f"import sys, {module}; print(*({SLOW!r} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert not run.stdout.split(), f"{module} imports {run.stdout.strip()} before it is needed"


def test_bare_folder_names_are_not_imported():
    """Each test may have imported anything by now, but never the folders by their bare names."""
    import deformrf.core.base.paths  # noqa: F401

    assert not {"core", "viewer"} & set(sys.modules)
