"""The repository's shape: who may import whom, what is installed, and under which name."""

import ast
import importlib
import subprocess
import sys
import tomllib
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SOURCES = sorted(p for folder in ("core", "viewer") for p in (ROOT / folder).rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))

# Each part may import itself and the parts named on its right.
MAY_IMPORT = {
    "core.base.paths": [],
    "core.base.children": [],
    "core.base.memory": [],
    "core.base.bytecode": [],
    "core.base.arguments": ["core.base.claims", "core.base.paths"],
    "core.base.claims": ["core.base.paths"],
    "core.base.reading": ["core.base.paths"],
    "core.base.streams": [],
    "core.base.shipped_kernels": ["core.base.paths"],
    "core.base.kernel_cache": ["core.base.paths", "core.base.shipped_kernels", "core.base.streams"],
    "core.base.device": ["core.base.kernel_cache"],
    "core.base.threads": ["core.base.device"],
    "core.base.wide": [],
    "core.base.native": [],
    "core.base.feed": [],
    "core.base.recorded": [],
    "core.base.images": ["core.base.reading"],
    "core.base.archive": ["core.base.memory", "core.base.reading", "core.base.streams"],
    "core.geometry": [],
    "wings.capture": [
        "core.base.paths",
        "core.base.children",
        "core.base.archive",
        "core.base.reading",
        "core.base.images",
        "core.base.memory",
        "core.base.streams",
        "core.base.device",
    ],
    "core.field": [
        "core.base.device",
        "core.base.paths",
        "core.base.archive",
        "core.base.memory",
        "core.base.streams",
        "core.base.wide",
        "core.base.native",
        "core.geometry",
    ],
    "wings.rig": [
        "core.base.paths",
        "core.base.reading",
        "core.base.memory",
        "core.base.archive",
        "core.base.streams",
        "core.base.feed",
        "core.geometry",
    ],
    "core.render": [
        "core.base.device",
        "core.base.threads",
        "core.base.wide",
        "core.base.native",
        "core.base.recorded",
        "core.geometry",
        "core.field",
    ],
    "core.deform": [
        "core.base.device",
        "core.base.native",
        "core.base.feed",
        "core.base.recorded",
        "core.geometry",
    ],
    "core.training": [
        "wings.capture",
        "core.base.paths",
        "core.base.streams",
        "core.base.reading",
        "core.base.images",
        "core.base.memory",
        "core.base.device",
        "core.base.wide",
        "core.geometry",
        "core.field",
        "core.render",
    ],
    "wings.lab": ["core"],
    "commands": ["core"],
    "viewer.history": ["core"],
    "viewer.camera": ["core"],
    "viewer.timeline": ["core", "viewer.history", "viewer.camera"],
    "viewer.rigging": ["core", "viewer.history"],
    "viewer.scene": [
        "core",
        "viewer.settings",
        "viewer.history",
        "viewer.camera",
        "viewer.timeline",
        "viewer.rigging",
    ],
    "viewer.sessions": [
        "core",
        "viewer.settings",
        "viewer.history",
        "viewer.camera",
        "viewer.timeline",
        "viewer.rigging",
        "viewer.scene",
    ],
    "viewer.files": ["core", "viewer.logs", "viewer.camera", "viewer.sessions"],
    "viewer.layers": [
        "core",
        "viewer.camera",
        "viewer.rigging",
        "viewer.scene",
        "viewer.files",
    ],
    "viewer.input": [
        "core",
        "viewer.settings",
        "viewer.camera",
        "viewer.timeline",
        "viewer.rigging",
        "viewer.scene",
        "viewer.files",
    ],
    "viewer": ["core"],
}
# Imports that still pass a room's door; each room empties its own.
PAST_THE_DOOR = set()
WINDOWING = ["moderngl", "pyglet", "imgui_bundle"]  # not in core: it runs without a display
SLOW = {
    "torch",
    "warp",
    "pyglet",
    "scipy",
    "matplotlib",
    "markdown_it",
}  # imported when used: --help has to answer at once
LINES_MAX = 400


def module_name(path):
    """core/field/encoding.py -> deformrf.core.field.encoding"""
    return ".".join(["deformrf", *path.relative_to(ROOT).with_suffix("").parts])


def is_within(module, *packages):
    return any(f"{module}.".startswith(f"{package}.") for package in packages)


def imported_modules(path):
    """Yield the full name of everything that a file imports."""
    package = module_name(path).split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            for alias in node.names:
                yield ".".join([*base, *filter(None, [node.module]), alias.name])


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_imports_follow_the_layers(path):
    here = module_name(path)
    part = next((p for p in MAY_IMPORT if is_within(here, f"deformrf.{p}")), None)
    allowed = [f"deformrf.{p}" for p in [part, *MAY_IMPORT[part]]] if part else [here]
    for module in imported_modules(path):
        assert not is_within(module, "core", "viewer"), f"{module}: write deformrf.{module}"
        if is_within(module, "deformrf"):
            assert is_within(module, *allowed), f"{here} may not import {module}"
        if is_within(here, "deformrf.core"):
            assert not is_within(module, *WINDOWING), f"{here} may not import {module}"


def is_module(name):
    """Whether deformrf.a.b is a module or a folder of modules in the tree."""
    path = ROOT.joinpath(*name.split(".")[1:])
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def passes_the_door(here, target):
    """Whether an import reaches behind the __init__ of a room that it isn't in itself.

    >>> passes_the_door("deformrf.viewer.camera.orbit", "deformrf.core.render.rays.camera")
    True
    """
    here, target = (name.removeprefix("deformrf.").split(".") for name in (here, target))
    if here[0] != target[0]:
        here, target = [], target[1:]  # core is no room, but a row of them
    elif here[0] == "core":
        here, target = here[1:], target[1:]
    while here and target and here[0] == target[0]:
        here, target = here[1:], target[1:]
    return len(target) > 1


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_rooms_are_entered_by_their_doors(path):
    """Only the lab reaches in, for references."""
    here = module_name(path).removesuffix(".__init__")
    if is_within(here, "deformrf.wings.lab"):
        return
    for name in imported_modules(path):
        target = name if is_module(name) else name.rpartition(".")[0]
        if not is_within(target, "deformrf") or not passes_the_door(here, target):
            continue
        pair = tuple(module.removeprefix("deformrf.") for module in (here, target))
        assert pair in PAST_THE_DOOR, f"{here} imports {target}: its room's door should have it"


@pytest.mark.parametrize("package", [m for m in map(module_name, SOURCES) if "__init__" in m])
def test_doors_open(package):
    """Every name that a door promises is there."""
    door = importlib.import_module(package.removesuffix(".__init__"))
    for name in getattr(door, "__all__", ()):
        assert hasattr(door, name), f"{package} has no {name}"


@pytest.mark.parametrize("path", SOURCES + TESTS, ids=module_name)
def test_files_stay_short(path):
    line_count = len(path.read_text(encoding="utf-8").splitlines())
    assert line_count <= LINES_MAX, f"{path.relative_to(ROOT)} has {line_count} lines: split it"


def test_every_package_is_installed():
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    folders = {p.parent for p in SOURCES}
    without_init = {str(f) for f in folders if not (f / "__init__.py").exists()}
    assert not without_init, "a folder of modules needs an __init__.py to be installed"
    found = {module_name(folder) for folder in folders}
    assert set(setuptools["packages"]) == found | {"deformrf.shaders", "deformrf.assets"}


def test_everything_beside_modules_is_installed():
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    data = setuptools["package-data"]
    for path in (ROOT / "core").rglob("*"):
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
        pin = pins.get(canonicalize_name(requirement.name))
        assert pin, f"constraints.txt lacks {requirement.name}"
        assert pin in requirement.specifier, f"constraints.txt has {pin}, wanted {requirement}"


@pytest.mark.parametrize(
    "module",
    [
        "deformrf.commands.training",
        "deformrf.commands.evaluate",
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


def test_a_viewer_s_arguments_need_no_checker_of_types():
    """For X | None tyro would import typeguard, and that 60 modules more, asyncio and ssl too."""
    program = (
        "import sys; from deformrf.viewer import command; command.main(['--version']);"
        "print('typeguard' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stdout.split()[-1:] == ["False"], run.stderr


def test_bare_folder_names_are_not_imported():
    """Each test may have imported anything by now, but never the folders by their bare names."""
    import deformrf.core.base.paths  # noqa: F401

    assert not {"core", "viewer"} & set(sys.modules)
