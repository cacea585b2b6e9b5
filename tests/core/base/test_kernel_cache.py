"""Kernels are compiled and run, whatever became of the folder that keeps them."""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from deformrf.core.base import kernel_cache

LOAD = """
import deformrf.core.base.device as device
device.start_warp()
import warp as wp
import deformrf.core.render.subpixel  # two small kernels
wp.load_module("deformrf.core.render.subpixel", "cpu")
print(wp.config.kernel_cache_dir)
"""


@pytest.fixture
def start(tmp_path):
    """Load a module in a process of its own; returns its cache and what it says on stderr."""

    def start(cache, state="state"):
        folders = {"WARP_CACHE_PATH": str(cache), "XDG_STATE_HOME": str(tmp_path / state)}
        done = subprocess.run(
            [sys.executable, "-c", LOAD],
            env={**os.environ, **folders, "TMPDIR": str(tmp_path)},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.strip(), done.stderr

    return start


def test_damaged_kernels_are_compiled_anew(start, tmp_path):
    assert start(tmp_path / "cache")[1] == ""
    (binary,) = (tmp_path / "cache").rglob("*.o")
    (meta,) = (tmp_path / "cache").rglob("*.meta")
    (sums,) = (tmp_path / "cache").rglob(kernel_cache.SUMS)
    whole = binary.read_bytes()
    # Without checksums, as of another version of the program, a file that can't be loaded.
    sums.unlink()
    for path, damaged in (
        (binary, whole[: len(whole) // 2]),
        (binary, whole[:300] + b"\xff" * 300 + whole[600:]),
        (meta, b""),
        (sums, b"[1"),
    ):
        path.write_bytes(damaged)
        said = start(tmp_path / "cache")[1]
        assert said.count("are damaged; they are compiled anew\n") == 1
        assert binary.read_bytes() == whole
    assert start(tmp_path / "cache")[1] == ""


def test_kernels_go_elsewhere_if_their_folder_cannot_be_made(start, tmp_path):
    (tmp_path / "file").touch()
    cache, said = start(tmp_path / "file" / "cache")
    assert cache.startswith(str(tmp_path / "state"))
    assert "can't be kept in" in said and cache in said and said.count("\n") == 1
    (kept,) = (tmp_path / "state").rglob("*.o")
    when = kept.stat().st_mtime_ns
    start(tmp_path / "file" / "cache")
    assert kept.stat().st_mtime_ns == when  # they are loaded from there the next time
    cache, said = start(tmp_path / "file" / "cache", state="file")
    assert cache.startswith(str(tmp_path / "deformrf-kernels-"))
    assert not list(tmp_path.glob("deformrf-kernels-*"))  # deleted at the end


def test_a_folder_without_room_is_none(tmp_path, monkeypatch):
    """Warp's compiler ends the process if the disk is full."""
    assert kernel_cache.problem(tmp_path / "a") == ""
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=2**20))
    assert kernel_cache.problem(tmp_path) == "1 MiB are free, 64 are needed"


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root writes anywhere")
def test_a_folder_that_is_only_read_is_enough_for_what_is_in_it(start, tmp_path):
    start(tmp_path / "cache")
    folders = [path for path in (tmp_path / "cache").rglob("*") if path.is_dir()]
    for folder in folders:
        folder.chmod(0o555)
    assert start(tmp_path / "cache")[1] == ""
    for folder in folders:
        folder.chmod(0o755)


@pytest.mark.skipif(sys.platform != "linux", reason="/proc can't be written by anybody")
def test_without_any_folder_commands_say_what_they_need(tmp_path, ball_file):
    code = "import sys, tempfile; tempfile.tempdir = '/proc/none'\n"
    code += "from deformrf.commands.entry import begin\nsys.exit(begin('edit'))"
    home = dict.fromkeys(("HOME", "XDG_STATE_HOME"), "/proc/none")
    home["WARP_CACHE_PATH"] = "/proc/none/w"
    command = [sys.executable, "-c", code, ball_file, "-o", tmp_path / "a.npz"]
    done = subprocess.run(command, env=os.environ | home, capture_output=True, text=True)
    assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.startswith("deformrf edit: can't write /proc/none/w")
    assert "WARP_CACHE_PATH" in last and list(tmp_path.iterdir()) == []
