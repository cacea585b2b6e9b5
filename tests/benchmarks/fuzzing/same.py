"""Data sets that were changed in ways that mean nothing: they have to load equal to the original.

COLMAP's text in other orders, with comments and other line ends; the paths of transforms.json as
other machines write them; films along a data set's cameras.  Here a refusal is a fault.
"""

import copy
import json

import numpy as np

from deformrf.core.render import Camera, camera_rays, in_space
from deformrf.core.training import load_dataset
from deformrf.viewer.films import load_camera_path
from deformrf.viewer.films.sight import seen_by

from .colmap import binary_files, text_files
from .datasets import FOCAL, HEIGHT, VIEWS, WIDTH, image_bytes, poses
from .trees import Tree

NEAR = 1e-5  # of poses, points and directions that text gives with few digits
HOME = "/home/x/data/toy"


def views_of(folder):
    """What is loaded, by the names of images."""
    found = {}
    for split in ("train", "test"):
        views = load_dataset(folder, split, for_training=split == "train")
        assert not views.missing, f"missing images: {len(views.missing)}"
        for i, name in enumerate(views.names):
            found[name] = (split, views.poses[i], views.lenses[i], views.image(i))
        if split == "train":
            found["points"] = views.points
    return found


def compare(one, other):
    """An AssertionError unless both are the same but for rounding."""
    assert one.keys() == other.keys(), "another set of images"
    for name, value in one.items():
        if name == "points":
            assert (value is None) == (other[name] is None), "points are lost, or come from nowhere"
            if value is not None:
                a, b = (np.sort(points, axis=0) for points in (value, other[name]))
                assert a.shape == b.shape and np.allclose(a, b, atol=NEAR), "other points"
            continue
        assert value[0] == other[name][0], "another split"
        assert np.allclose(value[1], other[name][1], atol=NEAR), "another pose"
        assert value[2] == other[name][2], "another lens"
        assert np.array_equal(value[3], other[name][3]), "other pixels"


class SameColmap(Tree):
    """COLMAP's text and binary files of one reconstruction."""

    def __init__(self, folder):
        text, binary = text_files(), binary_files()
        self.text = {f"sparse/0/{name}": content for name, content in text.items()}
        self.binary = {f"sparse/0/{name}": content for name, content in binary.items()}
        self.pictures = {f"images/a_b/r_({i}).png": image_bytes(i) for i in range(VIEWS)}
        spaced = {f"images/a b/r ({i}).png": image_bytes(i) for i in range(VIEWS)}
        self.variants = [self.pictures | self.text, spaced | self.binary]
        (folder / "text").mkdir()
        self.write(folder / "text", self.variants[0])
        self.truth = views_of(folder / "text")

    def mutate(self, rng, folder):
        files, pictures, what = dict(self.text), dict(self.pictures), []
        changes = rng.permutation(CHANGES)[: rng.integers(1, 4)].tolist()
        for change in sorted(changes, key=lambda change: change == "byte order mark"):
            what.append(change)
            _change(rng, change, files, pictures, self.binary)
        self.write(folder, pictures | files)
        return ", ".join(what)

    def read(self, folder):
        found = {name.replace(" ", "_"): value for name, value in views_of(folder).items()}
        compare(self.truth, found)


CHANGES = ["comments", "line ends", "no last line", "order", "spaces in names", "binary"]
CHANGES += ["smaller model first", "spaces at ends", "in colmap/sparse", "byte order mark"]


def _change(rng, change, files, pictures, binary):
    """Change a reconstruction in place, so that it means the same."""
    names = [name for name in files if name.endswith(".txt")]
    if change == "binary":
        for name in names:
            del files[name]
        files |= binary
        change = "spaces in names"
    if change == "spaces in names":
        for name in list(pictures):
            pictures[name.replace("_", " ")] = pictures.pop(name)
        for name in names:
            if name in files:
                files[name] = files[name].replace("a_b/r_(", "a b/r (")
        return
    if change == "smaller model first":
        for name in list(files):
            if "sparse/0" in name:
                files[name.replace("sparse/0", "sparse/1")] = files.pop(name)
        files |= {f"sparse/0/{name}": content for name, content in text_files(2).items()}
        if any(" " in name for name in pictures):
            files["sparse/0/images.txt"] = files["sparse/0/images.txt"].replace(
                "a_b/r_(", "a b/r ("
            )
        return
    if change == "in colmap/sparse":
        for name in [n for n in files if n.startswith("sparse")]:
            files[f"colmap/{name}"] = files.pop(name)
        return
    for name in names:
        if name not in files or not isinstance(files[name], str):
            continue
        lines = files[name].splitlines()
        per = 2 if "images" in name else 1
        if change == "comments":
            lines.insert(0, "# another comment")
            lines.append("# the end")
        elif change == "order":
            entries = [line for line in lines if not line.startswith("#")]
            groups = [entries[i : i + per] for i in range(0, len(entries), per)]
            lines = [line for i in rng.permutation(len(groups)) for line in groups[i]]
        elif change == "spaces at ends":
            lines = [line + "  " if i % per == 0 and "images" not in name else line
                     for i, line in enumerate(lines)]  # fmt: skip
        end = "\r\n" if change == "line ends" else "\n"
        text = end.join(lines) + ("" if change == "no last line" else end)
        files[name] = "\ufeff" + text if change == "byte order mark" else text


class SamePaths(Tree):
    """transforms.json whose paths another machine wrote, or another program."""

    def __init__(self, folder):
        frames = [
            {"file_path": f"images/{i:03d}.png", "transform_matrix": pose.tolist()}
            for i, pose in enumerate(poses())
        ]
        self.scene = {"w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "frames": frames}
        self.pictures = {f"images/{i:03d}.png": image_bytes(i) for i in range(VIEWS)}
        self.variants = [{"transforms.json": self.scene} | self.pictures]
        (folder / "own").mkdir()
        self.original(folder / "own")
        self.truth = views_of(folder / "own")

    def mutate(self, rng, folder):
        scene, pictures = copy.deepcopy(self.scene), dict(self.pictures)
        kind = int(rng.integers(len(SPELLINGS)))
        for frame in scene["frames"]:
            frame["file_path"] = SPELLINGS[kind].format(*_parts(frame["file_path"]))
        what, mark = SPELLINGS[kind], b""
        if rng.random() < 0.3:
            names = [f["file_path"] for f in scene["frames"]]
            order = [i for i in range(VIEWS) if i % 8]
            scene["train_filenames"] = [f"./{names[i]}" if i % 2 else names[i] for i in order]
            scene["test_filenames"] = [names[0], names[8]]
            what += ", lists of a split"
        if rng.random() < 0.2:
            scene["frames"] = [scene["frames"][i] for i in rng.permutation(VIEWS)]
            what += ", another order"
        if rng.random() < 0.2:
            lens = {name: scene.pop(name) for name in ("w", "h", "fl_x")}
            scene["frames"] = [frame | lens for frame in scene["frames"]]
            what += ", lens in frames"
        if rng.random() < 0.2:
            mark, what = b"\xef\xbb\xbf", f"{what}, byte order mark"
        text = json.dumps(scene, indent=[None, 1][rng.integers(2)])
        self.write(folder, pictures | {"transforms.json": mark + text.encode()})
        return what

    def read(self, folder):
        compare(self.truth, views_of(folder))


SPELLINGS = ["{0}/{1}.png", "./{0}/{1}.png", ".\\{0}\\{1}.png", "{0}\\{1}.png", "{0}/{1}"]
SPELLINGS += ["C:\\data\\toy\\{0}\\{1}.png", HOME + "/{0}/{1}.png", "{0}/{1}.PNG", "{0}/{1}.jpeg"]
SPELLINGS += [HOME + "/{0}/{1}.jpg", "../toy/{0}/{1}.png", "{0}//{1}.png", "{0}/./{1}.png"]
SPELLINGS += ["\\\\server\\share\\{0}\\{1}.png", "{0}/{1}.tif"]


def _parts(path):
    folder, _, name = path.partition("/")
    return folder, name.partition(".")[0]


class SameCameras(Tree):
    """A data set as a film's path: the rays of its photographs are those of training."""

    def __init__(self, folder):
        pictures = {f"images/{i:03d}.png": image_bytes(i) for i in range(VIEWS)}
        self.frames = [
            {"file_path": f"images/{i:03d}.png", "transform_matrix": pose.tolist()}
            for i, pose in enumerate(poses())
        ]
        self.pictures, self.variants = pictures, [pictures]

    def original(self, folder):
        lens = {"w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL}
        scene = lens | {"frames": self.frames}
        self.write(folder, self.pictures | {"transforms_train.json": scene})

    def mutate(self, rng, folder):
        size = {"w": WIDTH, "h": HEIGHT}
        x = FOCAL * rng.uniform(0.7, 1.5)
        lens = [
            size | {"fl_x": x},
            size | {"fl_x": x, "fl_y": x},
            size | {"camera_angle_x": 2 * np.arctan(0.5 * WIDTH / x)},
            {"camera_angle_x": 2 * np.arctan(0.5 * WIDTH / x)},
            {"fl_x": x},
            {"w": 10 * WIDTH, "h": 10 * HEIGHT, "fl_x": 10 * x},
            size | {"fl_x": x, "fl_y": 1.1 * x, "cx": 7.0, "cy": 6.5, "k1": 0.02, "p1": 1e-3},
        ][kind := int(rng.integers(7))]
        frames, shift = copy.deepcopy(self.frames), [0.0, 0.0, 0.0]
        if rng.random() < 0.3:
            shift = [448000.0, 5411000.0, 312.0]
        for frame in frames:
            for row in range(3):
                frame["transform_matrix"][row][3] += shift[row]
        each = rng.random() < 0.5
        scene = {"frames": [frame | lens for frame in frames]}
        scene = scene if each else lens | {"frames": frames}
        self.write(folder, self.pictures | {"transforms_train.json": scene})
        return f"lens {kind}, in frames: {each}, moved by {shift[0]:g}"

    def read(self, folder):
        views = load_dataset(folder, "train")
        to_model = np.eye(4)
        to_model[:3, 3] = -views.poses[:, :3, 3].mean(axis=0)
        keys = load_camera_path(folder / "transforms_train.json", to_model, np.zeros(3))
        assert len(keys) == views.view_count, "another number of cameras"
        for key, pose, lens in zip(keys, views.poses, views.lenses, strict=True):
            wanted = camera_rays(Camera(in_space(pose, to_model), lens))
            found = camera_rays(seen_by(key.orbit, lens.width, lens.height))
            apart = max(np.abs(a - b).max() for a, b in zip(wanted, found, strict=True))
            assert apart < 1e-3, "other rays than training's"
