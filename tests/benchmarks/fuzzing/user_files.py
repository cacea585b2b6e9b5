"""Files of the user's own: preferences, camera paths, and what lies in a capture's work folder."""

import json

import numpy as np

from deformrf.viewer import preferences
from deformrf.viewer.films import load_camera_path
from deformrf.viewer.films.camera_path import CameraPathError
from deformrf.viewer.settings import Settings
from deformrf.wings.capture import CaptureError, find_photos
from deformrf.wings.capture.work import Look, open_work

from .damage import json_bytes, with_bytes, with_values
from .datasets import image_bytes, poses
from .trees import Tree
from .watch import Refused


class Preferences(Tree):
    """What the viewer remembers: it never fails, and what was kept can be read again."""

    def __init__(self, folder):
        path = folder / "preferences.json"
        kept = preferences.Preferences(path=path, recent=["/home/x/a.npz", "/b c/ü.npz"])
        assert not kept.save()
        self.variants = [{path.name: json.loads(path.read_text(encoding="utf-8"))}]

    def read(self, folder):
        path, settings = folder / "preferences.json", Settings()
        loaded, problem = preferences.load(path)
        preferences.apply(loaded, settings)
        preferences.take(loaded, settings, 60.0)
        preferences.take_window(loaded, (640, 480))
        loaded.opened(folder / "a.npz")
        problem = problem or loaded.save()
        if problem:
            raise Refused(problem)
        _, again = preferences.load(path)
        assert not again, again


class CameraPaths(Tree):
    """Our own keys, nerfstudio's camera_path, and data sets in several forms."""

    errors = (CameraPathError, OSError)

    def __init__(self, folder):
        place = {"position": [1.5, -2.0, 1.0], "target": [0.5, 0.5, 0.5], "fov": 35}
        matrix = np.eye(4)
        matrix[2, 3] = 3.0
        ours = {"keys": [{"t": 0.0} | place]}
        ours["keys"].append({"t": 2.0, "transform_matrix": matrix.tolist(), "fov": 35})
        frames = [
            {"file_path": f"{i}.png", "transform_matrix": pose.tolist()}
            for i, pose in enumerate(poses(4))
        ]
        lens = {"w": 90, "h": 160, "fl_x": 150.0, "fl_y": 150.0, "cx": 45.0, "cy": 80.0}
        film = [{"camera_to_world": np.ravel(p).tolist(), "fov": 50, "aspect": 1} for p in poses(3)]
        theirs = {"camera_type": "perspective", "render_height": 90, "render_width": 160}
        theirs |= {"fps": 24, "seconds": 1, "is_cycle": False, "camera_path": film}
        each = {"frames": [frame | lens for frame in frames]}
        values = [ours, theirs, lens | {"frames": frames}, each]
        values += [{"camera_angle_x": 0.7, "frames": frames}, ours["keys"]]
        pictures = {f"{i}.png": image_bytes(i) for i in range(4)}
        self.often = ("transforms",)
        self.variants = [{"transforms.json": value} | pictures for value in values]

    def read(self, folder):
        path = folder / "transforms.json"
        for key in load_camera_path(path, np.eye(4), np.full(3, 0.5)):
            assert np.isfinite(key.orbit.target).all() and np.isfinite(key.orbit.distance)


class Works:
    """MODEL.capture with a work.json of all sorts, and somebody's own file in it, which stays."""

    errors = (CaptureError,)

    def __init__(self, folder):
        self.pictures = {f"{i}.png": image_bytes(i) for i in range(3)}

    def _photos(self, folder):
        (folder / "photos").mkdir()
        for name, data in self.pictures.items():
            (folder / "photos" / name).write_bytes(data)

    def original(self, folder):
        self._photos(folder)
        open_work(folder / "toy.capture", _found(folder), 64)

    def mutate(self, rng, folder):
        self.original(folder)
        work = folder / "toy.capture"
        value, kind = json.loads((work / "work.json").read_text()), int(rng.integers(6))
        if kind <= 1:
            (work / "work.json").write_text(json.dumps(with_values(rng, value)))
        elif kind == 2:
            (work / "work.json").write_bytes(json_bytes(rng, value)[0])
        elif kind == 3:
            (work / "work.json").write_text(json.dumps({"hours": 12}))
        elif kind == 4:
            (work / "work.json").unlink()
        else:
            (folder / "photos" / "0.png").write_bytes(self.pictures["1.png"])
        if rng.random() < 0.5:
            np.savez(
                work / "000000.npz", colors=np.zeros((3, 3), "u1"), sharpness=1.0, exposure=0.5
            )
            data = (work / "000000.npz").read_bytes()
            (work / "000000.npz").write_bytes(with_bytes(rng, data))
        if rng.random() < 0.7:
            name = ["thesis.txt", "features.db-old", "a/b.txt"][rng.integers(3)]
            (work / name).parent.mkdir(exist_ok=True)
            (work / name).write_text("years of work")
        return f"work.json {kind}"

    def read(self, folder):
        own = {p: p.read_bytes() for p in (folder / "toy.capture").rglob("*") if _is_own(p)}
        try:
            work, _ = open_work(folder / "toy.capture", _found(folder), 64)
            for number in range(3):
                if work.has_look(number):
                    assert isinstance(work.look(number), Look)
        finally:
            gone = [p.name for p in own if not p.exists() or p.read_bytes() != own[p]]
            assert not gone, f"a user's file is gone: {gone}"


def _is_own(path):
    return path.is_file() and path.read_bytes() == b"years of work"


def _found(folder):
    found = find_photos(folder / "photos")
    return found[0] if isinstance(found, tuple) else found
