"""A trained model posed by bones, against images of the object posed by the same bones.

    python tests/benchmarks/rig_truth.py MODEL DATA RIG.glb [--every N] [--pictures FOLDER]
        [--device cpu|cuda:0]

MODEL was trained on DATA.  DATA/rig.json has bones, and clips with skinning matrices and cameras
at some times, whose images lie beside it.  RIG.glb has that skeleton and its weights on a skinned
mesh; it is laid on the model by its shape.  Each way of weighting and blending is scored as it is
(skinned), after inverted tets are mended (untangled), and where the solver moves what bones do not
hold (physics):

    IoU        of {α ≥ ½}, mean over the images; ΔIoU: its difference to the rest pose's test views
    alpha dB, color dB    over white; the light of those images was computed for the posed object
    ratio      the smallest volume of a tet over its volume at rest; inverted: tets below 0

--every N takes each N-th image of a clip, --weights and --methods some of the ways.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from bone_physics import posed_with_physics

from deformrf.commands.rig_bind import BindArguments, bound
from deformrf.core.base.device import start_warp
from deformrf.core.base.images import open_image, rgba
from deformrf.core.deform import Material, XpbdSolver
from deformrf.core.field import modelfile
from deformrf.core.geometry import signed_volumes
from deformrf.core.render import Camera, Renderer, in_space
from deformrf.core.training import load_dataset, white_composite
from deformrf.core.training.metrics import psnr
from deformrf.wings import rig as rigs
from deformrf.wings.rig.untangle import Untangler

WEIGHTS = ("harmonic", "nearest", "rigid", "automatic")
PASSES = ("skinned", "untangled", "physics")
HEADINGS = ("IoU", "ΔIoU", "alpha dB", "color dB", "ratio", "inverted")


def frames_of(folder: Path, clip: dict, every: int):
    """Time, camera pose [4, 4] and image of each N-th frame of a clip."""
    frames = [(one["time"], frame) for one in clip["samples"] for frame in one["frames"]]
    for time, frame in frames[::every]:
        pose = np.array(frame["transform_matrix"], float)
        with open_image(folder / f"{frame['file_path']}.png") as file:
            yield time, pose, np.asarray(rgba(file))


def tet_quality(mesh, vertices):
    """The smallest volume ratio, and the number of inverted tets."""
    rest = signed_volumes(mesh.rest_vertices, mesh.tets)
    ratios = signed_volumes(np.asarray(vertices, float), mesh.tets) / rest
    return ratios.min(), int((ratios <= 0.0).sum())


def score(rendered, truth):
    """IoU, alpha PSNR and color PSNR of one view.  uint8 [H, W, 4] both"""
    alpha, true_alpha = rendered[..., 3] / 255.0, truth[..., 3] / 255.0
    inside, truly_inside = alpha >= 0.5, true_alpha >= 0.5
    iou = (inside & truly_inside).sum() / (inside | truly_inside).sum()
    color, true_color = rendered[..., :3] / 255.0, white_composite(truth)
    return iou, psnr(alpha, true_alpha), psnr(color, true_color)


def measure(renderer, dataset):
    """Mean scores over the views of a data set."""
    poses = in_space(dataset.poses, renderer.field.world_to_model)
    cameras = map(Camera, poses, dataset.lenses)
    rendered = (renderer.render(camera).color_array() for camera in cameras)
    images = map(dataset.image, range(len(poses)))
    return np.mean([score(*pair) for pair in zip(rendered, images, strict=True)], axis=0)


class Truth:
    """The clips of a data set, and what scores a way of posing against them."""

    def __init__(self, arguments):
        self.folder, self.every = arguments.data, arguments.every
        self.pictures = arguments.pictures
        field = modelfile.load(arguments.model)
        self.field, self.renderer = field, Renderer(field, arguments.device)
        file = self.folder / "rig.json"
        self.clips = json.loads(file.read_text())["clips"]
        self.rig = rigs.aligned(rigs.read_matrices(file), field.world_to_model)
        self.test = load_dataset(self.folder, "test")
        self.rest = measure(self.renderer, self.test)

    def frames(self, clip: str, time: float, skeleton):
        """The bones' frames that move them, by name, as the truth's.  [B, 4, 4]"""
        known = self.rig.skeleton
        clip = next(one for one in self.rig.clips if one.name == clip)
        order = [known.names.index(name) for name in skeleton.names]
        return clip.matrices_at(known, time)[order] @ skeleton.rest

    def score(self, clip: str, posed, label: str):
        """Mean scores of a clip's images, smallest ratio, inverted tets.

        `posed` gives the vertices at a time.
        """
        scores, ratio, inverted, at, vertices = [], np.inf, 0, None, None
        for time, pose, image in frames_of(self.folder, self.clips[clip], self.every):
            if time != at:
                at, vertices = time, posed(clip, time)
                self.renderer.set_vertices(vertices.astype(np.float32))
                least, count = tet_quality(self.field.mesh, vertices)
                ratio, inverted = min(ratio, least), inverted + count
            pose = in_space(pose[None], self.field.world_to_model)[0]
            camera = Camera(pose, self.test.lenses[0])
            rendered = self.renderer.render(camera).color_array()
            scores.append(score(rendered, image))
            if self.pictures:
                both = [rendered[..., :3], (255.0 * white_composite(image) + 0.5).astype(np.uint8)]
                name = f"{label}_{clip}_{len(scores):02d}.png".replace(" ", "_")
                Image.fromarray(np.concatenate(both, axis=1)).save(self.pictures / name)
        return np.mean(scores, axis=0), ratio, inverted


class Poser:
    """One rig's vertices at a time of a clip [V, 3], in each of PASSES."""

    def __init__(self, truth: Truth, rig, method):
        self._truth, self._rig, self._method = truth, rig, method
        self._mesh = truth.field.mesh
        self._untangler = Untangler(self._mesh)
        free = np.zeros(self._mesh.vertex_count, bool)
        self._solver = XpbdSolver(self._mesh.rest_vertices, self._mesh.tets, Material(), free)

    def skinned(self, clip, time):
        skeleton = self._rig.skeleton
        matrices = self._truth.frames(clip, time, skeleton) @ np.linalg.inv(skeleton.rest)
        rest = self._mesh.rest_vertices
        return rigs.skinned(rest, self._rig.weights, matrices, self._method, self._rig.offsets)

    def untangled(self, clip, time):
        return self._untangler(self.skinned(clip, time))

    def physics(self, clip, time):
        skeleton = self._rig.skeleton
        pose = rigs.pose_of(skeleton, self._truth.frames(clip, time, skeleton))
        way = {"method": self._method}
        return posed_with_physics(self._solver, self._mesh, self._rig, pose, **way)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("data", type=Path)
    parser.add_argument("rig", type=Path)
    parser.add_argument("--weights", nargs="+", default=WEIGHTS, choices=WEIGHTS)
    parser.add_argument("--methods", nargs="+", default=rigs.METHODS, choices=rigs.METHODS)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    start_warp()
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
    truth = Truth(arguments)
    iou, alpha, color = truth.rest
    print(f"rest pose: IoU {iou:.4f}, alpha {alpha:.2f} dB, color {color:.2f} dB")
    print(f"{'':46}" + "".join(f"{heading:>10}" for heading in HEADINGS))
    for kind in arguments.weights:
        bind = BindArguments(arguments.model, arguments.rig, Path(), weights=kind)
        rig, _ = bound(truth.field, bind)
        for method in arguments.methods:
            poser = Poser(truth, rig, method)
            for way in PASSES:
                for clip in truth.clips:
                    label = f"{kind}, {method}, {way}: {clip}"
                    scores, ratio, count = truth.score(clip, getattr(poser, way), label)
                    found, alpha, color = scores
                    cells = f"{found:10.4f}{found - iou:+10.4f}{alpha:10.2f}{color:10.2f}"
                    print(f"{label:46}{cells}{ratio:10.3f}{count:10d}", flush=True)


if __name__ == "__main__":
    main()
