"""Files that commands write and read: full disks, links, pipes, permissions, another process."""

import os
import signal
import stat
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from point_caches import write_cache

from deformrf.commands import edit, evaluate, rig
from deformrf.commands import render as render
from deformrf.commands import view as view
from deformrf.core import field as fields
from deformrf.wings import rig as rigs

resource = pytest.importorskip("resource")
pytestmark = pytest.mark.skipif(os.name != "posix", reason="links, pipes and limits of POSIX")


@pytest.fixture(scope="module")
def inputs(ball, tmp_path_factory):
    """A model with a rig and a clip, that rig, and a point cache."""
    folder = tmp_path_factory.mktemp("inputs")
    skeleton = rigs.make_skeleton(["a"], [-1], [(0.5, 0.5, 0.2)], [(0.5, 0.5, 0.8)])
    count, times = ball.mesh.vertex_count, np.arange(2) / 24.0
    clip = rigs.clip_of_poses("still", times, [skeleton.rest_pose] * 2)
    made = rigs.Rig(skeleton, np.ones((count, 1), np.float32), (clip,))
    np.savez(folder / "rig.npz", **rigs.arrays_of(made))
    fields.save(replace(ball, rig_arrays=rigs.arrays_of(made)), folder / "model.npz")
    frames = np.repeat(ball.mesh.rest_vertices[None].astype(np.float32), 2, axis=0)
    write_cache(rigs.VertexClip("cache", times, frames), folder / "cache.npz")
    return folder


WRITERS = {  # the command, its arguments before the file that it writes, and that file's ending
    "edit": (edit.main, ["model.npz", "--specks", "0", "-o"], ".npz"),
    "bind": (rig.main, ["bind", "model.npz", "rig.npz", "-o"], ".npz"),
    "import": (rig.main, ["import", "model.npz", "cache.npz", "-o"], ".npz"),
    "export": (rig.main, ["export", "model.npz", "-o"], ".ply"),
    "quality": (rig.main, ["quality", "model.npz", "--picture"], ".png"),
}


@pytest.fixture(params=WRITERS)
def write(request, call, inputs):
    """Runs a command that writes to a path [stem]; the path is `write.path`."""
    command, words, ending = WRITERS[request.param]
    names = [inputs / word if word.endswith(".npz") else word for word in words]

    def write(stem):
        write.path = stem.with_suffix(ending)
        return call(command, *names, write.path)

    write.ending = ending
    return write


@contextmanager
def full_disk(size=1000):
    """In the block, no file of this process can become larger [bytes]."""
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.getsignal(signal.SIGXFSZ)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("old", [None, b"old"])
def test_a_full_disk_is_a_sentence_and_the_old_file_is_whole(write, tmp_path, old):
    path = (tmp_path / "a").with_suffix(write.ending)
    if old:
        path.write_bytes(old)
    with full_disk():
        done = write(tmp_path / "a")
    assert done.code == 2 and done.err.count("\n") == 1
    assert f"can't write {path}: File too large" in done.err
    assert [p.read_bytes() for p in tmp_path.iterdir()] == ([old] if old else [])


def test_a_private_file_stays_private_and_a_link_stays_a_link(write, tmp_path):
    target = (tmp_path / "private").with_suffix(write.ending)
    target.write_bytes(b"old")
    target.chmod(0o600)
    link = (tmp_path / "a").with_suffix(write.ending)
    link.symlink_to(target.name)
    assert write(tmp_path / "a").code == 0
    assert link.is_symlink() and stat.S_IMODE(target.stat().st_mode) == 0o600
    assert target.read_bytes() != b"old"
    assert sorted(tmp_path.iterdir()) == sorted([link, target])


@pytest.mark.parametrize("kind", ["pipe", "device", "loop", "folder"])
def test_what_is_no_file_is_refused_at_once(write, tmp_path, kind, refused):
    path = (tmp_path / "a").with_suffix(write.ending)
    make = {
        "pipe": lambda: os.mkfifo(path),
        "device": lambda: path.symlink_to("/dev/null"),
        "loop": lambda: path.symlink_to(path.name),
        "folder": path.mkdir,
    }
    make[kind]()
    before = path.lstat().st_ino
    sentence = refused(write(tmp_path / "a"))
    assert f"can't write {path}: " in sentence and {"loop": "links"}.get(kind, kind) in sentence
    assert path.lstat().st_ino == before and list(tmp_path.iterdir()) == [path]


def test_two_processes_on_one_file_are_told(write, tmp_path, refused):
    path = (tmp_path / "a").with_suffix(write.ending)
    code = "import sys; from pathlib import Path; from deformrf.core.base.claims import claim;"
    code += "claim(Path(sys.argv[1])); print(1, flush=True); sys.stdin.read()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code, path], **pipes) as other:
        assert other.stdout.readline() == b"1\n"
        assert "is being written by another process" in refused(write(tmp_path / "a"))
        other.stdin.close()
        other.wait()
    assert write(tmp_path / "a").code == 0


def exits(main):
    """A command that returns its exit code, as one that exits with it."""

    def command():
        sys.exit(main())

    return command


READERS = {  # of a pipe or a device in the place of {}
    "edit": (edit.main, ["{}.npz", "-o", "out.npz"]),
    "bind a model": (rig.main, ["bind", "{}.npz", "rig.npz", "-o", "out.npz"]),
    **{
        f"bind {end}": (rig.main, ["bind", "model.npz", f"{{}}.{end}", "-o", "out.npz"])
        for end in ("npz", "glb", "gltf", "json")
    },
    **{
        f"import {end}": (rig.main, ["import", "model.npz", f"{{}}.{end}", "-o", "out.npz"])
        for end in ("npz", "pc2", "mdd")
    },
    "info": (rig.main, ["info", "{}.npz"]),
    "eval": (evaluate.main, ["{}.npz", "data"]),
    "view": (exits(view.main), ["{}.npz", "--headless", "--screenshot", "out.png"]),
    "view a session": (
        exits(view.main),
        ["model.npz", "--headless", "--screenshot", "out.png", "--session", "{}.jsonl"],
    ),
    **{
        f"render a {name}": (
            exits(render.main),
            ["model.npz", "-o", "out.mp4", f"--{name}", f"{{}}.{end}", *more],
        )
        for name, end, more in (
            ("session", "jsonl", []),
            ("camera", "json", []),
            ("pose", "npy", ["--turntable", "1"]),
            ("pose", "npz", ["--turntable", "1"]),
            ("pose", "jsonl", ["--turntable", "1"]),
        )
    },
}


@pytest.mark.parametrize("kind", ["pipe", "zero", "folder"])
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_not_read(
    call, inputs, data, tmp_path, monkeypatch, reader, kind, refused
):
    """A pipe that nobody writes to would never answer, and a device never end."""
    monkeypatch.chdir(tmp_path)
    command, words = READERS[reader]
    for name in ("model.npz", "rig.npz"):
        if not (tmp_path / name).exists():
            (tmp_path / name).symlink_to(inputs / name)
    name = next(word for word in words if "{}" in word).format("strange")
    if kind == "pipe":
        os.mkfifo(name)
    elif kind == "zero":
        os.symlink("/dev/zero", name)
    else:
        os.mkdir(name)
    words = [data if word == "data" else word.format("strange") for word in words]
    result = call(command, *words)
    lines = result.err.splitlines(True)  # a first start compiles kernels, and says so
    result.err = "".join(line for line in lines if not line.startswith("compiling kernels"))
    sentence = refused(result)
    assert "strange" in sentence and "it holds" not in sentence
    assert not [path for path in tmp_path.iterdir() if path.name.startswith("out")]
