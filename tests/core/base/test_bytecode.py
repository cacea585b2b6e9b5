"""Compiled Python modules are kept for a user where Python would keep none, and nowhere else."""

import os
import subprocess
import sys

import pytest

from deformrf.core.base import bytecode

PROGRAM = """
import sys
from pathlib import Path
from deformrf.core import bytecode
bytecode.LARGE = "large"
bytecode.keep(Path(sys.argv[1]))
import large
print(large.__cached__)
"""


@pytest.fixture
def packages(tmp_path):
    """A folder with a package that has no bytecode."""
    (tmp_path / "packages" / "large").mkdir(parents=True)
    (tmp_path / "packages" / "large" / "__init__.py").write_text("NUMBER = 7\n")
    return tmp_path / "packages"


@pytest.fixture
def here(packages, monkeypatch):
    """This process as one that was started where bytecode is forbidden, and nothing else said."""
    monkeypatch.syspath_prepend(packages)
    monkeypatch.setattr(bytecode, "LARGE", "large")
    monkeypatch.setattr(bytecode, "_is_said", lambda: False)
    monkeypatch.setattr(sys, "pycache_prefix", None)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)


def started(packages, folder, *options, **variables):
    """Where a program with `bytecode.keep` has the bytecode of the package."""
    own = ("PYTHONDONTWRITEBYTECODE", "PYTHONPYCACHEPREFIX")
    environment = {name: value for name, value in os.environ.items() if name not in own}
    environment["PYTHONPATH"] = os.pathsep.join([os.fspath(packages), *sys.path])
    ended = subprocess.run(
        [sys.executable, *options, "-c", PROGRAM, folder],
        env={**environment, **variables},
        capture_output=True,
        text=True,
        check=True,
    )
    return ended.stdout.strip()


def bytecode_in(folder):
    return sorted(path.name for path in folder.rglob("*.pyc"))


def test_forbidden_bytecode_is_kept_for_the_user(packages, tmp_path):
    kept = tmp_path / "kept"
    path = started(packages, kept, PYTHONDONTWRITEBYTECODE="1")
    assert path.startswith(os.fspath(kept)) and os.path.exists(path)
    assert not bytecode_in(packages)


def test_python_keeps_its_own_where_it_can(packages, tmp_path):
    kept = tmp_path / "kept"
    assert started(packages, kept).startswith(os.fspath(packages))
    assert bytecode_in(packages) and not kept.exists()
    # From now on there is some, so nothing has to be kept elsewhere.
    started(packages, kept, PYTHONDONTWRITEBYTECODE="1")
    assert not kept.exists()


def test_a_folder_that_the_user_names_is_taken(packages, tmp_path):
    named, kept = tmp_path / "named", tmp_path / "kept"
    assert started(packages, kept, PYTHONPYCACHEPREFIX=os.fspath(named)).startswith(
        os.fspath(named)
    )
    assert bytecode_in(named) and not kept.exists()


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs POSIX")
def test_a_folder_that_others_can_write_to_is_not_used(packages, tmp_path):
    kept = tmp_path / "kept"
    kept.mkdir()
    kept.chmod(0o777)
    assert started(packages, kept, PYTHONDONTWRITEBYTECODE="1").startswith(os.fspath(packages))
    assert not list(kept.iterdir()) and not bytecode_in(packages)


def test_an_option_that_forbids_bytecode_is_obeyed(packages, tmp_path):
    assert started(packages, tmp_path / "kept", "-B").startswith(os.fspath(packages))
    assert not (tmp_path / "kept").exists() and not bytecode_in(packages)


@pytest.mark.usefixtures("here")
def test_packages_that_are_only_read_have_theirs_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    bytecode.keep(tmp_path / "kept")
    assert sys.pycache_prefix is None, "Python writes it beside the module"
    monkeypatch.setattr(bytecode.os, "access", lambda path, mode: False)
    bytecode.keep(tmp_path / "kept")
    assert sys.pycache_prefix == os.fspath(tmp_path / "kept")


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs POSIX")
def test_a_link_is_not_used(packages, tmp_path):
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (tmp_path / "kept").symlink_to(tmp_path / "elsewhere")
    started(packages, tmp_path / "kept", PYTHONDONTWRITEBYTECODE="1")
    assert not list((tmp_path / "elsewhere").iterdir())


@pytest.mark.usefixtures("here")
def test_a_full_disk_gets_none(tmp_path, monkeypatch):
    full = bytecode.shutil.disk_usage(tmp_path)._replace(free=bytecode.ROOM - 1)
    monkeypatch.setattr(bytecode.shutil, "disk_usage", lambda _: full)
    bytecode.keep(tmp_path / "kept")
    assert sys.pycache_prefix is None
    monkeypatch.setattr(bytecode.shutil, "disk_usage", lambda _: full._replace(free=bytecode.ROOM))
    bytecode.keep(tmp_path / "kept")
    assert sys.pycache_prefix == os.fspath(tmp_path / "kept")


def test_no_folder_can_be_made(packages, tmp_path):
    (tmp_path / "file").write_text("")
    kept = tmp_path / "file" / "kept"
    assert started(packages, kept, PYTHONDONTWRITEBYTECODE="1").startswith(os.fspath(packages))


@pytest.mark.usefixtures("here")
def test_a_package_that_is_not_there_changes_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(bytecode, "LARGE", "no_such_package")
    bytecode.keep(tmp_path / "kept")
    assert sys.pycache_prefix is None and not (tmp_path / "kept").exists()
