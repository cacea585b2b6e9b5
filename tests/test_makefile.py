"""make installs nothing outside the checkout, but for debian-packages; PYTHON is heeded."""

import os
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def machine(tmp_path):
    """Run make where no Debian package is installed and every command is a stub.

    Returns:
        A function of a target and of make's variables, that returns make's result and the list of
        the stubs' calls.  The environment's stub and `python3.9` are Pythons of a version.
    """
    log, commands, venv = tmp_path / "log", tmp_path / "bin", tmp_path / "venv"
    stub = f'#!/bin/sh\necho "$(basename "$0") $*" >> {log}\n'
    version = 'case "$*" in *"print(sys.version"*) echo {};; *ensurepip*) exit {};; esac\n'
    for folder, names in (
        (commands, {"sudo": "", "apt-get": "", "dpkg-query": "exit 1\n"}),
        (commands, {"other3.13": version.format("3.13.0", 0), "python3.9": version.format(3.9, 1)}),
        (venv / "bin", {"python": version.format("3.12.1", 0), "pip": "", "deformrf": ""}),
    ):
        folder.mkdir(parents=True, exist_ok=True)
        for name, ending in names.items():
            (folder / name).write_text(stub + ending)
            (folder / name).chmod(0o755)
    for stamp in ("installed", "viewing"):
        (venv / stamp).touch()

    def make(target, **variables):
        inherited = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS")}
        environment = {**inherited, "PATH": f"{commands}:{os.environ['PATH']}"}
        command = ["make", target, f"VENV={venv}", *(f"{k}={v}" for k, v in variables.items())]
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
        return done, log.read_text().splitlines()

    return make


@pytest.mark.parametrize(
    "target, started", [("demo", "deformrf view"), ("test", "python -m pytest")]
)
def test_set_up_only_says_what_the_system_lacks(machine, target, started):
    done, calls = machine(target)
    assert done.returncode == 0, done.stderr
    assert not [call for call in calls if call.startswith(("sudo", "apt-get"))]
    assert "libegl1" in done.stdout and "make debian-packages" in done.stdout
    assert [call for call in calls if call.startswith(started)]


def test_viewing_needs_no_virtual_screen(machine):
    done, _ = machine("demo")
    assert "xvfb" not in done.stdout


def test_a_target_of_its_own_installs_debian_packages(machine):
    done, calls = machine("debian-packages")
    assert done.returncode == 0, done.stderr
    (install,) = [call for call in calls if "install" in call and "apt-get" in call]
    assert "libegl1" in install and "xvfb" in install
    assert install.startswith("apt-get" if os.getuid() == 0 else "sudo env")


def test_soak_says_how_to_repeat_it(machine):
    done, calls = machine("soak")
    assert done.returncode == 0, done.stderr
    assert "DEFORMRF_TEST_SEED=" in done.stdout
    assert [call for call in calls if call.startswith("python -m pytest")]


def test_a_python_of_another_version_makes_the_environment_anew(machine):
    done, calls = machine("demo", PYTHON="other3.13")
    assert done.returncode == 0, done.stderr
    created = next(
        n for n, call in enumerate(calls) if call.startswith("other3.13 -m venv --clear")
    )
    installed = [n for n, call in enumerate(calls) if call.startswith("python -m pip install")]
    assert len(installed) == 2 and created < min(installed)


@pytest.mark.parametrize("variables", [{}, {"PYTHON": "python"}], ids=["none", "same"])
def test_an_environment_that_fits_stays(machine, tmp_path, variables):
    """Also where none is given, and `python3` is of another version."""
    variables = {name: tmp_path / "venv" / "bin" / value for name, value in variables.items()}
    done, calls = machine("demo", **variables)
    assert done.returncode == 0, done.stderr
    assert not [call for call in calls if " -m venv" in call or " -m pip" in call]


def test_where_no_python_fits_make_names_what_fetches_one(machine):
    done, calls = machine("demo", PYTHON="python3.9")
    assert done.returncode != 0
    assert "Python 3.11 to 3.14" in done.stderr and '"python3.9" is not one' in done.stderr
    assert "uv venv " in done.stderr and "&& make demo" in done.stderr
    assert not [call for call in calls if " -m venv" in call or " -m pip" in call]


def test_the_bounds_of_python_are_those_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert project["requires-python"] == ">=3.11,<3.15"
    for name in ("Makefile", "setup.py"):
        assert "(3, 11) <= sys.version_info[:2] <= (3, 14)" in (ROOT / name).read_text("utf-8")
    minors = {c[-2:] for c in project["classifiers"] if "Python :: 3.1" in c}
    assert minors == {"11", "12", "13", "14"}
