"""Kernels that are shipped compiled are those of the sources, and a cache gets them whole."""

import os
import subprocess
import sys
import tarfile
from types import SimpleNamespace

import pytest

from deformrf.core.base import shipped_kernels
from deformrf.core.base.paths import ROOT

PROGRAM = ROOT / "tests" / "benchmarks" / "ship_kernels.py"
VIEW = "--headless --frames 2 --drag top:0.1,0,0 --device cuda --screenshot".split()


@pytest.fixture
def hopper():
    """What `unpack` asks of a Warp device with CUDA."""
    return SimpleNamespace(is_cpu=False, arch=90)


def module_of(key):
    """What `unpack` asks of a Warp module."""
    return SimpleNamespace(get_module_hash=lambda block_dim: bytes.fromhex(key))


@pytest.fixture
def key(hopper):
    """The hash of a module that is shipped."""
    return next(iter(shipped_kernels.read(shipped_kernels.archive_path(hopper.arch))))


def test_shipped_kernels_are_those_of_the_sources():
    done = subprocess.run([sys.executable, PROGRAM, "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_an_archive_without_a_module_is_told_of(tmp_path):
    """The check of the test above can fail."""
    path = tmp_path / shipped_kernels.archive_path(90).name
    with (
        tarfile.open(shipped_kernels.archive_path(90)) as whole,
        tarfile.open(path, "w:xz") as some,
    ):
        for member in whole:
            if "subpixel" not in member.name:
                some.addfile(member, whole.extractfile(member))
    options = ["--check", "--architectures", "90", "--output", tmp_path]
    done = subprocess.run([sys.executable, PROGRAM, *options], capture_output=True, text=True)
    assert done.returncode == 1
    assert "lacks deformrf.core.render.subpixel: make kernels" in done.stderr


def test_a_cache_gets_a_shipped_module_once(tmp_path, hopper, key, monkeypatch):
    module = module_of(key)
    assert shipped_kernels.has(module, hopper, 256)
    shipped_kernels.unpack(module, hopper, 256, tmp_path / "module")
    files = {path.name: path for path in (tmp_path / "module").iterdir()}
    assert {path.suffix for path in files.values()} == {".cubin", ".meta"}
    (binary,) = (path for path in files.values() if path.suffix == ".cubin")
    assert binary.name.endswith(".sm90.cubin") and binary.read_bytes()[:4] == b"\x7fELF"
    binary.write_bytes(b"another")  # as one that Warp compiled
    monkeypatch.setattr(shipped_kernels, "_modules", None)  # nor is an archive read
    shipped_kernels.unpack(module, hopper, 256, tmp_path / "module")
    assert binary.read_bytes() == b"another"


def test_what_is_not_shipped_or_cannot_be_written_is_left_to_the_compiler(tmp_path, hopper, key):
    changed = module_of("00" * 32)
    assert not shipped_kernels.has(changed, hopper, 256)
    shipped_kernels.unpack(changed, hopper, 256, tmp_path / "module")
    module = module_of(key)
    for device in SimpleNamespace(is_cpu=False, arch=52), SimpleNamespace(is_cpu=True):
        assert not shipped_kernels.has(module, device, 256)
        shipped_kernels.unpack(module, device, 256, tmp_path / "module")
    assert not (tmp_path / "module").exists()
    (tmp_path / "file").write_bytes(b"")
    shipped_kernels.unpack(module, hopper, 256, tmp_path / "file" / "module")
    assert (tmp_path / "file").read_bytes() == b""


@pytest.mark.parametrize("content", [b"", b"no archive", None])
def test_a_damaged_archive_is_no_archive(tmp_path, hopper, caplog, content):
    path = tmp_path / "sm90.tar.xz"
    whole = shipped_kernels.archive_path(hopper.arch).read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if content is None else content)
    assert shipped_kernels.read(path) == {}
    assert "they are compiled" in caplog.text


@pytest.mark.gpu
def test_a_first_start_compiles_nothing(tmp_path):
    import warp as wp

    if not shipped_kernels.archive_path(wp.get_device("cuda:0").arch).exists():
        pytest.skip("no kernels are shipped for this architecture")
    subprocess.run(
        [sys.executable, "-m", "deformrf.viewer", *VIEW, tmp_path / "a.png"],
        env={**os.environ, "WARP_CACHE_PATH": str(tmp_path / "cache")},
        check=True,
    )
    assert list(tmp_path.rglob("*.cubin")) and not list(tmp_path.rglob("*.cu"))
