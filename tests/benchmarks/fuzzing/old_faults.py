"""Faults that the program once had, put back one by one: the fuzzers have to find each.

What is put back is the old behavior, simplified: a check that is gone, a limit that is none, the
function as it was.  Each runs in a process of its own, until its fault is found.
"""

import importlib
import json
import os
import shutil
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import watch

ENDLESS = 2**62
LONGEST = 2.0  # s that a mutant may take here: what is put back takes much longer


@dataclass(frozen=True)
class OldFault:
    """One fault.

    Attributes:
        kind: Of mutants that find it.
        put_back: Changes the program in this process.
        signs: Words of which the watcher's name of the fault has one.
        first: With seed 0, a mutant not long before one that finds it.
    """

    name: str
    kind: str
    put_back: Callable
    signs: tuple[str, ...]
    first: int = 0


def module(name):
    return importlib.import_module(f"deformrf.{name}")


def exchange(old, new):
    """Put a function in the place of another one, in all modules that have it."""
    places = [
        (one, name)
        for one in list(sys.modules.values())
        if getattr(one, "__name__", "").startswith("deformrf.")
        for name, value in vars(one).items()
        if value is old
    ]
    assert places, f"{old} is nowhere"
    for place, name in places:
        setattr(place, name, new)


def points_by_numpy():
    """points.npz as NumPy reads it: what it declares is taken, and some errors come through."""
    points = module("core.training.data.points")

    def load_points(folder):
        path = Path(folder) / points.POINTS_FILE
        if not path.is_file():
            return None
        try:
            with np.load(path) as archive:
                return points.SparsePoints(**{name: archive[name] for name in points.SHAPES})
        except (OSError, ValueError, KeyError, EOFError, AssertionError):
            raise ValueError(f"{path} holds no sparse points") from None

    exchange(points.load_points, load_points)


def points_by_pycolmap():
    """points3D.bin as pycolmap reads it: as many points as it counts."""
    import pycolmap

    files = module("core.training.data.colmap_files")

    def read_points(path):
        try:
            found = pycolmap.Reconstruction(str(path.parent)).points3D.values()
        except Exception as error:
            raise files.DatasetError("pycolmap can't read it") from error
        return np.array([point.xyz for point in found]).reshape(-1, 3)

    exchange(files.read_points, read_points)


def names_end_at_spaces():
    """COLMAP's text, whose names were cut at the first space."""
    files = module("core.training.data.colmap_files")
    old = files.fields_of

    def fields_of(number, line, count, form):
        fields, rest = old(number, line, count, form)
        return fields, rest.split()[0] if form == files.IMAGE_FIELDS else rest

    exchange(old, fields_of)


def paths_as_they_are():
    """Paths of another machine, which nobody looked for."""
    paths = module("core.training.data.foreign_paths")
    paths._Nearby.like = lambda self, name, source: None


def lens_of_the_root():
    """A film along a data set's cameras, with what the file's root says of their lens."""
    module("viewer.films.camera_path")._is_data_set = lambda read: False


def rest_without_bones():
    """The edit "rest_bones" of a model without bones, and errors that come through."""
    posing = module("viewer.document.rigging.posing")
    player = module("viewer.document.sessions.player")

    def rest_bones(self, bones):
        return self._rigging.skeleton.rest_pose

    @contextmanager
    def told(self):
        try:
            yield
        except ValueError as error:
            raise player.SessionError(f"it can't be played: {error}") from error

    posing.Posing.rest_bones, player.Player._told = rest_bones, told


def a_day_at_once():
    """A session of a day, played tick by tick without a pause."""

    def play_to(self, tick, seconds=None):
        journal, events = self.scene.journal, self.session.events
        with self._told():
            while journal.tick < tick or self._made < len(events):
                if self._made < len(events) and events[self._made].tick <= journal.tick:
                    self._made += 1
                    self._make(events[self._made - 1])
                else:
                    self.scene.clock.tick()
        return True

    module("viewer.document.sessions.player").Player.play_to = play_to


def keys_without_end():
    """A glTF file's channels that share keys, which each took its own copy of."""
    for name in ("gltf", "gltf_file"):
        one = module(f"wings.rig.{name}")
        for limit in ("MOST_CHANNELS", "MOST_KEYS", "MOST_NUMBERS", "MOST_VALUES"):
            if hasattr(one, limit):
                setattr(one, limit, ENDLESS)


def chains_walked_for_each_bone():
    """A glTF file's nodes, of which each bone walked through all above it."""
    nodes = module("wings.rig.gltf_nodes")
    old = nodes.placed

    def placed(gltf, tree, bones):
        for bone in bones:
            matrix, node = np.eye(4), bone
            while node >= 0:
                matrix, node = np.eye(4) @ matrix, tree.parents[node]
        return old(gltf, tree, bones)

    exchange(old, placed)


def values_printed_whole():
    """A checkpoint's options, printed however long they are."""
    checks = module("core.training.run.checkpoint_checks")
    exchange(checks.check_content, lambda content, most: None)
    checks.shown = repr


def work_removed_whole():
    """The folder of work on photographs, removed with all that is in it."""
    work = module("wings.capture.work")
    work.Work.remove = lambda self: not shutil.rmtree(self.folder)
    old = work.held
    exchange(old, lambda folder: old(folder) if folder.exists() and old(folder) else {})


def video_without_codec():
    """A video's width, asked for before it is known that there is a decoder."""
    video = module("wings.capture.video")
    old = video.frames_of

    def frames_of(path, advance):
        with video.av.open(str(path), metadata_errors="replace") as container:
            sizes = [stream.width for stream in container.streams.video]
        assert all(side > 0 for side in sizes)
        yield from old(path, advance)

    exchange(old, frames_of)


FAULTS = [
    OldFault("points.npz of NumPy", "points", points_by_numpy, ("points", "more than")),
    OldFault("counts of points3D.bin", "colmap", points_by_pycolmap, ("more than",)),
    OldFault(
        "names with spaces", "same_colmap", names_end_at_spaces, ("Images", "set of", "Dataset")
    ),
    OldFault("foreign paths", "same_paths", paths_as_they_are, ("Images", "set of", "Dataset")),
    OldFault("the film's lens", "same_cameras", lens_of_the_root, ("rays", "CameraPath")),
    OldFault("rest_bones", "sessions", rest_without_bones, ("AttributeError",), 21),
    OldFault("a session of a day", "sessions", a_day_at_once, ("more than",)),
    OldFault("shared keys", "gltf", keys_without_end, ("more than",), 5),
    OldFault("chains of nodes", "gltf", chains_walked_for_each_bone, ("more than",), 17),
    OldFault("lists that double", "checkpoints", values_printed_whole, ("more than",), 12),
    OldFault("a user's folder", "works", work_removed_whole, ("file is gone",)),
    OldFault("an unknown codec", "videos", video_without_codec, ("AttributeError",)),
]


def find(fault: OldFault, make_kind, seed, folder: Path, seconds) -> tuple[str, str]:
    """Put a fault back, and look for it; then read the same mutants without it.

    Returns:
        Its name by the watcher, empty if it was not found or is there without it; and what was
        tried, in words.
    """
    first = fault.first if seed == 0 else 0
    found, count, took, problem = _apart(fault, make_kind, seed, folder, seconds, first)
    if not found:
        return "", f"NOT FOUND in {count} mutants, {took:.1f} s {problem}"
    said, _, _, problem = _apart(fault, make_kind, seed, folder, ENDLESS, first, count)
    if said or problem:
        return "", f"ALSO WITHOUT IT: {said} {problem}"
    return found, f"{count} mutants until {first + count - 1}, {took:.1f} s"


def _apart(fault, *arguments):
    """`_look_for` in a process of its own, since it changes the program."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            said = _look_for(fault, *arguments)
        except BaseException as error:
            said = ["", 0, 0.0, str(error)]
        os.write(writing, json.dumps(said).encode())
        os._exit(0)
    os.close(writing)
    with open(reading, "rb") as file:
        said = json.loads(file.read())
    os.waitpid(pid, 0)
    return said


def _look_for(fault, make_kind, seed, folder, seconds, first, most=None):
    """Put it back unless there are `most` mutants; its name, how many mutants, seconds, and ""."""
    if most is None:
        fault.put_back()
    watch.LONGEST = LONGEST
    start = time.monotonic()

    def signs(summary):
        return [one for one in summary.faults if any(sign in one for sign in fault.signs)]

    summary = watch.run(
        make_kind, fault.kind, seed, folder, seconds, most, until=signs, first=first
    )
    found = (signs(summary) or [""])[0]
    return [found, summary.mutants, time.monotonic() - start, ""]
