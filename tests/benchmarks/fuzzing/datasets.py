"""Data sets: transforms.json in its many forms, masks, NSVF, and the points beside them."""

import io

import numpy as np
from PIL import Image

from deformrf.core.base import images
from deformrf.core.render import look_at
from deformrf.core.training import DatasetError, load_dataset, world_to_unit_cube

from .trees import Arrays, Tree

WIDTH, HEIGHT, FOCAL = 16, 12, 20.0
VIEWS = 9
KINDS = [("png", {}), ("jpg", {}), ("webp", {}), ("tif", {"compression": "tiff_lzw"})]
ORIENTATION = 0x0112


def poses(count=VIEWS):
    """Cameras around the origin.  [n, 4, 4]"""
    turns = 2 * np.pi * np.arange(count) / count
    return [look_at((4 * np.cos(t), 4 * np.sin(t), 1.0), (0, 0, 0)) for t in turns]


def image_bytes(number, ending="png", orientation=1, **options) -> bytes:
    """A small image of random colors, opaque in its middle."""
    rng, stream = np.random.default_rng(number), io.BytesIO()
    shape = (WIDTH, HEIGHT) if orientation >= 5 else (HEIGHT, WIDTH)
    pixels = rng.integers(0, 256, (*shape, 4)).astype(np.uint8)
    pixels[..., 3] = 0
    pixels[3:-3, 3:-3, 3] = 255
    image = Image.fromarray(pixels)
    if ending in ("jpg", "tif"):
        image = image.convert("RGB")
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    names = {"jpg": "JPEG", "tif": "TIFF", "png": "PNG", "webp": "WEBP"}
    if orientation > 1:
        options = options | {"exif": exif}
    image.save(stream, names[ending], **options)
    return stream.getvalue()


def mask_bytes(number, mode="L") -> bytes:
    stream = io.BytesIO()
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[3:-3, 2 + number % 4 : -2] = 255
    Image.fromarray(mask).convert(mode).save(stream, "PNG")
    return stream.getvalue()


def point_arrays(count=9) -> Arrays:
    rng = np.random.default_rng(count)
    return Arrays(
        points=rng.normal(size=(count, 3)).astype("f4"),
        colors=rng.integers(0, 256, (count, 3)).astype("u1"),
        track_length=np.full(count, 2, "i4"),
        errors=np.full(count, 0.5, "f4"),
    )


def read_all(folder, masks=None):
    """What training reads before it begins."""
    views = load_dataset(folder, "train", for_training=True, masks=masks)
    world_to_unit_cube(views)
    load_dataset(folder, "test", image_size=8)


class Transforms(Tree):
    """Blender's, instant-ngp's and nerfstudio's layouts, with images of any EXIF."""

    errors = (DatasetError,)
    often = ("transforms",)

    def __init__(self, folder):
        images.LARGE, images.AT_A_TIME = 0, 64  # the checks of large images, too
        frames = [
            {"file_path": f"images/{i:03d}", "transform_matrix": pose.tolist()}
            for i, pose in enumerate(poses())
        ]
        shared = {"w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL, "cx": 8.0, "cy": 6.0}
        plain = {f"images/{i:03d}.png": image_bytes(i) for i in range(VIEWS)}
        blender = {"transforms_train.json": {"camera_angle_x": 0.7, "frames": frames}}
        blender["transforms_test.json"] = blender["transforms_train.json"]
        lenses = {"k1": 0.01, "k2": 1e-3, "p1": 1e-4, "p2": 0.0, "camera_model": "OPENCV"}
        named = [f | {"file_path": f"images/{i:03d}.png"} for i, f in enumerate(frames)]
        split = {"train_filenames": [f["file_path"] for f in named[1:]]}
        split["test_filenames"] = [named[0]["file_path"]]
        each = {"frames": [f | shared | {"time": i / 9} for i, f in enumerate(named)]}
        masked = [f | {"mask_path": f"masks/{i:03d}.png"} for i, f in enumerate(named)]
        masks = {f"masks/{i:03d}.png": mask_bytes(i) for i in range(VIEWS)}
        mixed, turned = {}, []
        for i, frame in enumerate(frames):
            ending, options = KINDS[i % 4]
            number = 1 + i % 8 if ending == "jpg" else 1
            name = f"images/{i:03d}.{ending}"
            mixed[name] = image_bytes(i, ending, number, **options)
            own = {"w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL}
            turned.append(frame | own | {"file_path": name, "upright": number > 1})
        points = {"points.npz": point_arrays()}
        self.variants = [
            blender | plain,
            {"transforms.json": shared | lenses | split | {"frames": named}} | plain | points,
            {"transforms.json": each} | plain,
            {"transforms.json": shared | {"frames": masked}} | plain | masks,
            {"transforms.json": {"frames": turned}} | mixed | points,
        ]

    def read(self, folder):
        read_all(folder)


class Masks(Tree):
    """--masks: a folder of masks in several kinds of pixels, some in subfolders."""

    errors = (DatasetError,)
    often = ("masks",)

    def __init__(self, folder):
        frames, files = [], {}
        for i, pose in enumerate(poses()):
            sub = "ab"[i % 2]
            files[f"images/{sub}/{i:03d}.png"] = image_bytes(i)
            name = (f"{sub}/{i:03d}.png", f"{i:03d}.png.png", f"{i:03d}_mask.png")[i % 3]
            files[f"masks/{name}"] = mask_bytes(i, ("L", "1", "P", "LA", "RGBA")[i % 5])
            matrix = {"transform_matrix": pose.tolist()}
            frames.append({"file_path": f"images/{sub}/{i:03d}.png"} | matrix)
        lens = {"w": WIDTH, "h": HEIGHT, "fl_x": FOCAL}
        self.variants = [{"transforms.json": lens | {"frames": frames}} | files]

    def read(self, folder):
        read_all(folder, folder / "masks")


class Nsvf(Tree):
    """NSVF's layout: text files with matrices."""

    errors = (DatasetError,)
    often = (".txt",)

    def __init__(self, folder):
        files = {}
        for i, pose in enumerate(poses()):
            stem = f"{int(i % 4 == 3)}_{i:04d}"
            rows = (pose * [1, -1, -1, 1]).tolist()
            files[f"pose/{stem}.txt"] = "\n".join(" ".join(map(repr, row)) for row in rows) + "\n"
            files[f"rgb/{stem}.png"] = image_bytes(i)
        files["bbox.txt"] = "-1.0 -1.0 -1.0 1.0 1.0 1.0 0.1\n"
        matrix = [[FOCAL, 0, 8, 0], [0, FOCAL, 6, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        long = "\n".join(" ".join(map(str, row)) for row in matrix) + "\n"
        short = f"{FOCAL} 8.0 6.0 0.\n0. 0. 0.\n0.\n1.\n{HEIGHT} {WIDTH}\n"
        self.variants = [files | {"intrinsics.txt": text} for text in (long, short)]

    def read(self, folder):
        read_all(folder)


class Points(Tree):
    """points.npz beside a transforms.json, and the .ply of other programs."""

    errors = (DatasetError,)
    often = ("points", ".ply")

    def __init__(self, folder):
        frames = [
            {"file_path": f"{i}.png", "transform_matrix": pose.tolist()}
            for i, pose in enumerate(poses(5))
        ]
        files = {f"{i}.png": image_bytes(i) for i in range(5)}
        scene = {"camera_angle_x": 0.7, "ply_file_path": "sparse_pc.ply", "frames": frames}
        self.variants = [
            files | {"transforms.json": scene, "points.npz": point_arrays()},
            files | {"transforms.json": scene, "sparse_pc.ply": PLY},
        ]

    def read(self, folder):
        read_all(folder)


PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property uint8 red
property uint8 green
property uint8 blue
end_header
0.0 0.0 0.0 255 0 0
1.0 0.0 0.5 0 255 0
0.0 1.0 0.2 0 0 255
"""
