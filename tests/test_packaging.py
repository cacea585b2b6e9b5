"""The package as pip installs it: its dependencies, its extras, a wheel in an empty environment."""

import email
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from readme_lines import NO_INDEX

from deformrf.commands.running import PACKAGES

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
# The wheel is installed for each; "make soak" names several.
PYTHONS = os.environ.get("PYTHONS", sys.executable).split()

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


def names_of(requirements):
    return {canonicalize_name(Requirement(r).name) for r in requirements}


VIEW = names_of(PROJECT["dependencies"])


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


def test_without_an_extra_nothing_of_training_is_installed():
    assert not with_requirements(VIEW) & {"torch", "scipy", "matplotlib", "pycolmap"}


def test_an_error_names_an_extra_that_has_the_package():
    distributions = metadata.packages_distributions() | {"pxr": ["usd-core"]}
    for module, (_, extra) in PACKAGES.items():
        has = names_of(EXTRAS[extra]) if extra else VIEW
        assert {canonicalize_name(n) for n in distributions.get(module, [module])} & has, module
    train, everything = names_of(EXTRAS["train"]), Requirement(EXTRAS["all"][0])
    assert everything.extras == {"train", "report"} and "torch" in train


def test_no_page_and_no_error_takes_the_package_from_an_index():
    patterns = (
        "*.md",
        "docs/**/*.md",
        ".github/**/*.yml",
        "Makefile",
        "*.py",
        "*/**/*.py",
        "*/**/*.pyi",
    )
    for path in [path for pattern in patterns for path in ROOT.glob(pattern)]:
        if path.is_relative_to(ROOT / "tests") or {".venv", "__pycache__"} & {*path.parts}:
            continue
        said = path.read_text("utf-8")
        assert not re.search(r"pip install ['\"]?deformrf(?!-\S+\.whl)", said), path


def test_address_authors_and_version_are_those_of_pyproject():
    """A citation file has no references: CONTRIBUTING.md says where to change them."""
    cited = (ROOT / "CITATION.cff").read_text("utf-8").partition("preferred-citation:")[0]
    assert re.search(r"^version: (.*)$", cited, re.M)[1] == PROJECT["version"]
    assert re.search(r'^url: "(.*)"$', cited, re.M)[1] == PROJECT["urls"]["Homepage"]
    assert re.findall(r'- name: "(.*)"', cited) == [a["name"] for a in PROJECT["authors"]]


@pytest.mark.usefixtures("window")  # skipped where there is no OpenGL
def test_viewing_imports_its_dependencies_and_nothing_else(ball_file, tmp_path):
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
    assert used >= VIEW, f"viewing doesn't import {VIEW - used}: it belongs into an extra"


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    """The wheel of this checkout, built in a copy: a build leaves folders behind."""
    source, folder = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    unneeded = shutil.ignore_patterns(".*", "build", "dist", "out", "docs", "tests", "__pycache__")
    shutil.copytree(ROOT, source, ignore=unneeded, dirs_exist_ok=True)
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "-q", "-w", folder, source], check=True)
    (path,) = folder.glob("*.whl")
    return path


def test_a_wheel_has_its_licenses_and_a_readme_for_an_index(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (about,) = [name for name in names if name.endswith(".dist-info/METADATA")]
        told = email.message_from_bytes(archive.read(about))
    info = about.rpartition("/")[0]
    assert {name.partition("/")[0] for name in names} == {"deformrf", info}
    modules = {name for name in names if re.fullmatch(r"deformrf/[^/]+", name)}
    assert modules == {f"deformrf/{name}" for name in ("__init__.py", "__init__.pyi", "py.typed")}
    assert (
        told["Version"] == PROJECT["version"] and told["License-Expression"] == PROJECT["license"]
    )
    for pattern in PROJECT["license-files"]:
        assert [n for n in names if Path(n).match(f"{info}/licenses/{pattern}")], pattern
    readme = told.get_payload()
    address = PROJECT["urls"]["Homepage"]
    assert f"{address}/raw/HEAD/docs/figures/" in readme
    assert not re.search(r"\]\((?!https?:|#)|src=\"(?!https?:)", readme)


@pytest.mark.usefixtures("window")
@pytest.mark.parametrize("python", PYTHONS, ids=lambda python: Path(python).name)
def test_a_wheel_in_an_empty_environment_views(wheel, python, tmp_path):
    """With an empty HOME, from another folder; a command without its extra says what to type."""
    found = shutil.which(python)  # of pyenv it may be a script that finds nothing
    if not found or run([found, "-c", "import ensurepip"]).returncode:
        pytest.skip(f"{python} is not there, or it can't make environments")
    venv = tmp_path / "venv"
    subprocess.run([python, "-m", "venv", venv], check=True)
    pip = [venv / "bin" / "pip", "install", "--retries", "1", "--no-compile"]
    done = run([*pip, "-c", ROOT / "constraints.txt", wheel])
    if done.returncode and NO_INDEX.search(done.stdout + done.stderr):
        assert "DEFORMRF_REQUIRE_INDEX" not in os.environ, done.stderr
        pytest.skip("no package index can be reached from here")
    assert done.returncode == 0, done.stderr

    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "XDG_", "WARP_"))}
    options = {"cwd": tmp_path, "env": kept | {"HOME": str(tmp_path)}}
    view = ["--headless", "--frames", "1", "--size", "64x48", "--screenshot", "a.png"]
    done = run([venv / "bin" / "deformrf", "view", *view], **options)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.png").stat().st_size
    for command, extra in ("train . -o m.npz", "train"), ("report", "report"):
        done = run([venv / "bin" / "deformrf", *command.split()], **options)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
        assert f'pip install "{wheel.name}[{extra}]"' in done.stderr


def run(command, **options):
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, **options)
