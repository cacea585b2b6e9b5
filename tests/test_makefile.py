"""make demo and make test install nothing outside the checkout; make debian-packages does."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def machine(tmp_path):
    """Run make where no Debian package is installed and every command is a stub.

    Returns:
        A function of a target, that returns make's result and the list of the stubs' calls.
    """
    log, commands, venv = tmp_path / "log", tmp_path / "bin", tmp_path / "venv"
    stub = f'#!/bin/sh\necho "$(basename "$0") $*" >> {log}\n'
    for folder, names in (
        (commands, {"sudo": "", "apt-get": "", "dpkg-query": "exit 1\n"}),
        (venv / "bin", {"python": "", "deformrf-view": ""}),
    ):
        folder.mkdir(parents=True)
        for name, ending in names.items():
            (folder / name).write_text(stub + ending)
            (folder / name).chmod(0o755)
    for stamp in ("installed", "viewing"):
        (venv / stamp).touch()

    def make(target):
        inherited = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS")}
        environment = {**inherited, "PATH": f"{commands}:{os.environ['PATH']}"}
        command = ["make", target, f"VENV={venv}"]
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
        return done, log.read_text().splitlines()

    return make


@pytest.mark.parametrize(
    "target, started", [("demo", "deformrf-view"), ("test", "python -m pytest")]
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
