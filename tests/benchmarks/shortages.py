"""Run every command where something is missing, and look at how it ends.

    python tests/benchmarks/shortages.py [--only files] [--command train]

Each command is run on small inputs, once with all that it needs and once under each of SHORTAGES.
It has to do its work, or to end in a sentence of its own on stderr: no traceback, no exit code but
0, 1 and 2, and what lay at its output is whole.  Read-only and full disks are mounts in a namespace
of the process, which only root can make on Linux; they are left out elsewhere.
"""

import argparse
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from ball_photos import photographs
from fuzzing.models import small_models
from point_caches import write_cache

from deformrf.core import field as fields
from deformrf.viewer.document import Scene, save_session, start_of
from deformrf.wings import rig as rigs

RUN = """
import sys
from deformrf.commands.entry import main
sys.exit(main())
"""
LONGEST = 900.0  # s
OUT = "{out}"
COMMANDS = {  # {out}: the folder that they write to
    "view": "view {rigged} --headless --frames 2 --size 64x48 --device cpu "
    "--session {session} --screenshot {out}/a.png --record {out}/a.mp4",
    "render": "render {rigged} --session {session} --size 64x48 --device cpu -o {out}/a.mp4",
    "pictures": "render {rigged} --turntable 0.1 --size 64x48 --device cpu -o {out}/pngs",
    "train": "train {data} -o {out}/a.npz --preset tiny --steps 200 --spacing 0.08 "
    "--scene-radius 0.6 --device cpu",
    "eval": "eval {model} {data} --split train --views 2 -o {out}/a.json "
    "--pictures {out}/pictures --device cpu",
    "edit": "edit {rigged} -o {out}/a.npz --specks 0",
    "export": "rig export {model} -o {out}/a.ply",
    "import": "rig import {rigged} {cache} -o {out}/a.npz",
    "check": "rig check {rigged} {cache}",
    "bind": "rig bind {model} {rig} -o {out}/a.npz",
    "info": "rig info {rigged}",
    "quality": "rig quality {rigged} --picture {out}/a.png",
    "report": "report {model} -o {out}/report --quick --device cpu",
}
READ_ONLY = "mount -t tmpfs -o ro,size=4k none {place}"
FULL = "mount -t tmpfs -o size=4k none {place}"
# Else each command compiles for a minute; test_kernel_cache.py is about that.
KERNELS = {"WARP_CACHE_PATH": str(Path.home() / ".cache" / "warp")}
SHORTAGES = {  # mounts of a shell, environment, limits
    "nothing": ((), {}, {}),
    "files": ((), {}, {resource.RLIMIT_NOFILE: 32}),
    "fewer files": ((), {}, {resource.RLIMIT_NOFILE: 14}),
    "memory": ((), {}, {resource.RLIMIT_DATA: 3 << 30}),
    "large files": ((), {}, {resource.RLIMIT_FSIZE: 300}),
    "home": ((), {"HOME": "/proc/none"} | KERNELS, {}),
    "temporary": (
        (READ_ONLY.format(place="/tmp"), READ_ONLY.format(place="/var/tmp")),
        {"TMPDIR": "/proc/none"},
        {},
    ),
    "home and temporary": (
        (READ_ONLY.format(place="/tmp"), READ_ONLY.format(place="/var/tmp")),
        {"TMPDIR": "/proc/none", "HOME": "/proc/none"} | KERNELS,
        {},
    ),
    "a place for kernels": (
        (READ_ONLY.format(place="/tmp"), READ_ONLY.format(place="/var/tmp")),
        {"TMPDIR": "/proc/none", "HOME": "/proc/none"},
        {},
    ),
    "writing": ((READ_ONLY.format(place=OUT),), {}, {}),
    "room": ((FULL.format(place=OUT),), {}, {}),
}


def prepared(folder: Path) -> dict[str, Path]:
    """The inputs of all commands, in a folder."""
    paths = {name: folder / name for name in ("data", "session", "model", "rigged", "rig", "cache")}
    for name in ("model", "rigged", "rig", "cache"):
        paths[name] = paths[name].with_suffix(".npz")
    shutil.copy(next(small_models(folder)), paths["model"])
    field = fields.load(paths["model"])
    scene = Scene(field, "model", "cpu")
    for height in (0.2, 0.5, 0.8):
        scene.rigging.add_joint(np.array([0.5, 0.5, height]))
    times, rig = np.arange(3) / 24.0, scene.rigging.rig
    still = rigs.clip_of_poses("still", times, [rig.skeleton.rest_pose] * 3)
    rig = replace(rig, clips=(still,))
    np.savez(paths["rig"], **rigs.arrays_of(rig))
    rigged = replace(field, rig_arrays=rigs.arrays_of(rig))
    fields.save(rigged, paths["rigged"])
    frames = np.repeat(field.mesh.rest_vertices[None].astype(np.float32), 3, axis=0)
    write_cache(rigs.VertexClip("cache", times, frames), paths["cache"])
    scene = Scene(fields.load(paths["rigged"]), "rigged", "cpu")
    start = start_of(scene)
    scene.set_gravity(3.0)
    scene.clock.advance(0.1)
    paths["session"] = save_session(scene, start, folder / "session.jsonl")
    images, frames = photographs(), []
    (paths["data"] / "train").mkdir(parents=True)
    for number in range(images.view_count):
        pixels = images.image(number).copy()
        pixels[..., 3] = np.where(pixels[..., 0] > 150, 255, 0)  # the ball
        Image.fromarray(pixels).save(paths["data"] / "train" / f"{number}.png")
        matrix = np.eye(4)
        matrix[:3] = images.poses[number][:3]
        frames.append({"file_path": f"train/{number}", "transform_matrix": matrix.tolist()})
    angle = 2.0 * float(np.arctan(0.5 / 1.4))
    scene = {"camera_angle_x": angle, "frames": frames}
    (paths["data"] / "transforms_train.json").write_text(json.dumps(scene))
    return paths


def run(words, mounts, environment, limits, out: Path):
    """Run a command under a shortage; exit code, its stderr, and seconds."""
    command = [sys.executable, "-c", RUN, *words]
    if mounts:
        script = " && ".join([*(one.replace(OUT, str(out)) for one in mounts), 'exec "$@"'])
        command = ["unshare", "-m", "sh", "-c", script, "sh", *command]

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        for number, value in limits.items():
            resource.setrlimit(number, (value, value))

    gone = ("XDG_STATE_HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "DISPLAY")
    known = {key: value for key, value in os.environ.items() if key not in gone} | environment
    options = {"env": known, "preexec_fn": limit, "cwd": "/proc", "timeout": LONGEST}
    since = time.monotonic()
    try:
        done = subprocess.run(command, capture_output=True, text=True, **options)
    except subprocess.TimeoutExpired as late:
        return "late", str(late.stderr or ""), LONGEST
    return done.returncode, done.stderr, time.monotonic() - since


def verdict(code, said: str) -> str:
    """What is wrong with the end of a command; empty if nothing is."""
    if code not in (0, 1, 2):
        return f"exit code {code}"
    for word in ("Traceback", "fault of the program", "Exception ignored"):
        if word in said:
            return word
    return "no sentence" if code and "deformrf-" not in said else ""


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", choices=SHORTAGES)
    parser.add_argument("--command", choices=COMMANDS, action="append")
    arguments = parser.parse_args()
    root = sys.platform == "linux" and os.geteuid() == 0
    folder = Path(tempfile.mkdtemp(prefix="deformrf-shortages-", dir=Path.home()))
    paths, faults = prepared(folder), 0
    try:
        for shortage, (mounts, environment, limits) in SHORTAGES.items():
            if arguments.only not in (None, shortage) or (mounts and not root):
                continue
            for name, line in COMMANDS.items():
                if arguments.command and name not in arguments.command:
                    continue
                out = folder / "out"
                shutil.rmtree(out, ignore_errors=True)
                out.mkdir()
                words = line.format(out=out, **paths).split()
                code, said, seconds = run(words, mounts, environment, limits, out)
                wrong = verdict(code, said)
                faults += bool(wrong)
                last = (said.strip().splitlines() or [""])[-1][:150]
                print(f"without {shortage}: {name}: {code}, {seconds:.0f} s, {last}", flush=True)
                if wrong:
                    print(f"    FAULT: {wrong}\n{said[-3000:]}", flush=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    print(f"{faults} faults")
    sys.exit(faults > 0)


if __name__ == "__main__":
    main()
