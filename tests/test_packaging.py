"""What make demo installs is what viewing imports: no torch, no scipy, no matplotlib."""

import os
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())
VIEW = {canonicalize_name(name) for name in PROJECT["dependency-groups"]["view"]}

# Views a model and opens the panels' module while modules outside ALLOWED can't be found.
PROGRAM = """
import sys

allowed, *arguments = sys.argv[1:]
allowed = {*allowed.split(), *sys.stdlib_module_names, "deformrf"}

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in allowed:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
from deformrf.commands.view import main

code = main(arguments)
import deformrf.viewer.gui
print(*{name.partition(".")[0] for name in sys.modules})
sys.exit(code)
"""


def with_requirements(names):
    """The installed distributions of these names, and all that they require."""
    found, ahead = set(), list(names)
    while ahead:
        name = canonicalize_name(ahead.pop())
        if name in found:
            continue
        found.add(name)
        wanted = map(Requirement, metadata.requires(name) or ())
        ahead += [r.name for r in wanted if r.marker is None or r.marker.evaluate({"extra": ""})]
    return found


def test_the_group_for_viewing_is_part_of_the_dependencies():
    assert VIEW < {
        canonicalize_name(Requirement(r).name) for r in PROJECT["project"]["dependencies"]
    }
    assert not with_requirements(VIEW) & {"torch", "scipy", "matplotlib"}


@pytest.mark.usefixtures("window")  # skipped where there is no OpenGL
def test_viewing_imports_its_group_and_nothing_else(ball_file, tmp_path):
    distributions = {
        module: {canonicalize_name(name) for name in names}
        for module, names in metadata.packages_distributions().items()
    }
    installed = with_requirements(VIEW)
    allowed = [module for module, names in distributions.items() if names & installed]
    arguments = [ball_file, "--headless", "--frames", "2", "--size", "64x48"]
    arguments += ["--mode", "error"]  # renders in default mode and in conformance mode
    arguments += ["--drag", "top:0.1,0,0", "--record", tmp_path / "a.mp4"]
    arguments += ["--screenshot", tmp_path / "a.png"]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, " ".join(allowed), *map(str, arguments)],
        env={k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.png").stat().st_size and (tmp_path / "a.mp4").stat().st_size
    imported = set(done.stdout.splitlines()[-1].split())
    used = {name for module in imported for name in distributions.get(module, ())}
    assert used >= VIEW, f"viewing doesn't import {VIEW - used}: take it out of the group"
