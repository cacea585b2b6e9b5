"""A trained model, deformed, against images of the object deformed in the same way.

    python tests/benchmarks/deformed_truth.py MODEL DATA_ROOT [--device cpu|cuda:0]
        [--size PIXELS] [--pictures FOLDER]

MODEL was trained on DATA_ROOT/helmet.  Its rest vertices are pushed through the closed-form
maps behind DATA_ROOT/helmet_twist and helmet_lean, and the images are scored in five ways of
telling a deformed field's direction and path length:

    as defined         direction Qᵀd, optical depth σ·|F⁻¹d|·dt
    direction d        not rotated
    current length     σ·dt, pieces cut as before
    neither            d and σ·dt
    direction F⁻¹d     normalised

The light in those images was computed for the deformed object, so color can't match exactly;
alpha can.  IoU is that of {α ≥ ½}, ΔIoU its difference to the undeformed model's on the same
views of helmet; all figures are means over views, color and SSIM over white.

Last, rays along z through the model squashed along z: an opaque object looks from there as it
does at rest, so the image at rest is the truth.
"""

import argparse
from pathlib import Path

import numpy as np
import warp as wp
from PIL import Image
from views import subset

from deformrf.core.base.device import start_warp
from deformrf.core.definition.deformation import deformation
from deformrf.core.field import GEOMETRY_FEATURES, basis_of, basis_vector, modelfile
from deformrf.core.render import Camera, Renderer, RenderOptions, in_space
from deformrf.core.render.rounds.compositing import ray_sums
from deformrf.core.training import load_dataset, white_composite
from deformrf.core.training.metrics import psnr, ssim

WAYS = {  # name: direction, path length
    "as defined": ("Qᵀd", "rest"),
    "direction d": ("d", "rest"),
    "current length": ("Qᵀd", "current"),
    "neither": ("d", "current"),
    "direction F⁻¹d": ("F⁻¹d", "rest"),
}
HEADINGS = ("IoU", "ΔIoU", "alpha dB", "color dB", "SSIM")
HOST_ROUNDS = RenderOptions(path="host")  # whose networks can be replaced
SQUASHES = (1.0, 0.3, 0.1)
SQUASH_SIZE = 200  # rays each way
OFF_LATTICE = 1.37e-4  # in the planes of the lattice rounding decides what a ray meets


def twist(p):
    """World space.  [V, 3]"""
    t = np.clip((p[:, 2] + 0.6) / 1.4, 0.0, 1.0)
    angle = np.radians(45.0) * t * t * (3.0 - 2.0 * t)
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2]])


def lean(p):
    q = np.maximum(0.0, p[:, 2] + 0.7)
    return p + np.outer(0.15 * q * q, [1.0, 0.0, 0.0])


MAPS = {"helmet_twist": twist, "helmet_lean": lean}


@wp.kernel
def current_length_kernel(
    directions: wp.array(dtype=wp.vec3),  # [R]
    rest_from_current: wp.array(dtype=wp.mat33),  # [T] F⁻¹
    alive: wp.array(dtype=int),  # [threads] ray of each
    counts: wp.array(dtype=int),  # [threads] samples of each
    ends: wp.array(dtype=int),  # [threads] inclusive scan of counts
    sample_tet: wp.array(dtype=int),  # [N]
    length: wp.array(dtype=float),  # [N] in: at rest; out: in the pose
):
    i = wp.tid()
    direction = directions[alive[i]]
    n = ends[i] - counts[i]
    while n < ends[i]:
        length[n] = length[n] / wp.length(rest_from_current[sample_tet[n]] * direction)
        n += 1


@wp.kernel
def turned_basis_kernel(
    directions: wp.array(dtype=wp.vec3),
    turns: wp.array(dtype=wp.mat33),  # [T] what stands for Qᵀ
    alive: wp.array(dtype=int),
    counts: wp.array(dtype=int),
    ends: wp.array(dtype=int),
    sample_tet: wp.array(dtype=int),
    basis: wp.array(dtype=basis_vector),  # [N] out
):
    i = wp.tid()
    direction = directions[alive[i]]
    n = ends[i] - counts[i]
    while n < ends[i]:
        basis[n] = basis_of(wp.normalize(turns[sample_tet[n]] * direction))
        n += 1


@wp.kernel
def turned_values_kernel(
    directions: wp.array(dtype=wp.vec3),  # [R]
    turns: wp.array(dtype=wp.mat33),  # [T] what stands for Qᵀ
    alive: wp.array(dtype=int),
    counts: wp.array(dtype=int),
    ends: wp.array(dtype=int),
    sample_tet: wp.array(dtype=int),
    values: wp.array(dtype=ray_sums),  # [N] their directions are out
):
    i = wp.tid()
    direction = directions[alive[i]]
    n = ends[i] - counts[i]
    while n < ends[i]:
        turned = wp.normalize(turns[sample_tet[n]] * direction)
        value = values[n]
        for k in range(3):
            value[wp.static(GEOMETRY_FEATURES) + k] = turned[k]
        values[n] = value
        n += 1


class WayRenderer(Renderer):
    """The renderer with another direction or path length."""

    direction, length = WAYS["as defined"]

    def __init__(self, field, device):
        super().__init__(field, device)
        self._defined_basis, self.shading.basis = self.shading.basis, self._basis
        self._defined_values, self.shading._values = self.shading._values, self._values
        self._defined_shade, self.shading.shade = self.shading.shade, self._shade
        self.host_rounds._on_cpu = None  # native code knows no other way

    def set_vertices(self, vertices):
        super().set_vertices(vertices)
        mesh = self.part.mesh
        inverses = deformation(mesh.rest_vertices, vertices, mesh.tets).inverse_f
        still = np.tile(np.eye(3), (mesh.tet_count, 1, 1))
        self._rest_from_current, self._still = (
            wp.array(turns.astype(np.float32), dtype=wp.mat33, device=self.device)
            for turns in (inverses, still)
        )

    def _shade(self, rays, found, *rest):
        if self.length == "current":
            inputs = self._inputs(rays, self._rest_from_current, found)
            outputs = [found.samples.length]
            wp.launch(current_length_kernel, len(found.ids), inputs, outputs, device=self.device)
        return self._defined_shade(rays, found, *rest)

    def _turns(self):
        return {"d": self._still, "F⁻¹d": self._rest_from_current}[self.direction]

    def _values(self, rays, found, h):
        values = self._defined_values(rays, found, h)
        if self.direction != "Qᵀd":
            inputs = self._inputs(rays, self._turns(), found)
            wp.launch(turned_values_kernel, len(found.ids), inputs, [values], device=self.device)
        return values

    def _basis(self, rays, found):
        if self.direction == "Qᵀd":
            return self._defined_basis(rays, found)
        turns = self._turns()
        basis = wp.empty(len(found.samples.tet), dtype=basis_vector, device=self.device)
        inputs = self._inputs(rays, turns, found)
        wp.launch(turned_basis_kernel, len(found.ids), inputs, [basis], device=self.device)
        return basis

    def _inputs(self, rays, turns, found):
        return [rays.directions, turns, found.ids, found.counts, found.ends, found.samples.tet]


def mapped_vertices(field, map_world):
    """Rest vertices pushed through a map of world space, in model space.  [V, 3]"""
    matrix = field.world_to_model
    world = (field.mesh.rest_vertices - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T
    return map_world(world) @ matrix[:3, :3].T + matrix[:3, 3]


def score(rendered, truth):
    """IoU, alpha PSNR, color PSNR and SSIM of one view.  uint8 [H, W, 4] both"""
    alpha, true_alpha = rendered[..., 3] / 255.0, truth[..., 3] / 255.0
    inside, truly_inside = alpha >= 0.5, true_alpha >= 0.5
    iou = (inside & truly_inside).sum() / (inside | truly_inside).sum()
    color, true_color = rendered[..., :3] / 255.0, white_composite(truth)
    return iou, psnr(alpha, true_alpha), psnr(color, true_color), ssim(color, true_color)


def measure(renderer, dataset, pictures=None):
    """Mean scores over the views; the renders and truths of some go to a folder."""
    poses = in_space(dataset.poses, renderer.field.world_to_model)
    scores = []
    for view, (pose, lens) in enumerate(zip(poses, dataset.lenses, strict=True)):
        rendered = renderer.render(Camera(pose, lens), HOST_ROUNDS).color_array()
        truth = dataset.image(view)
        scores.append(score(rendered, truth))
        if pictures and view % 8 == 0:
            color = (255.0 * white_composite(truth) + 0.5).astype(np.uint8)
            both = np.concatenate([rendered[..., :3], color], axis=1)
            Image.fromarray(both).save(f"{pictures}_{dataset.names[view]}.png")
    return np.mean(scores, axis=0)


def print_row(name, scores, iou):
    cells = (f"{scores[0]:.4f}", f"{scores[0] - iou:+.4f}", *(f"{s:.2f}" for s in scores[1:3]))
    print(f"{name:32}" + "".join(f"{c:>10}" for c in (*cells, f"{scores[3]:.4f}")), flush=True)


def print_squashes(renderer):
    """Mean opacity where the object is opaque at rest, and PSNR to the image at rest."""
    field = renderer.field
    low, high = field.mesh.rest_vertices.min(axis=0), field.mesh.rest_vertices.max(axis=0)
    x, y = (np.linspace(low[i], high[i], SQUASH_SIZE) + OFF_LATTICE for i in (0, 1))
    origins = np.stack(np.meshgrid(x, y, [high[2] + 0.1]), axis=-1).reshape(-1, 3)
    directions = np.tile([0.0, 0.0, -1.0], (len(origins), 1))
    print(f"\n{'squashed along z':32}" + "".join(f"{h:>10}" for h in ("opacity", "color dB")))
    at_rest = None
    for factor in SQUASHES:
        squashed = (field.mesh.rest_vertices - high) * [1.0, 1.0, factor] + high
        for length in ("rest", "current"):
            renderer.direction, renderer.length = "Qᵀd", length
            renderer.set_vertices(squashed)
            color, opacity, _ = renderer.render_rays(origins, directions)
            at_rest = at_rest or (color, opacity >= 0.5)
            inside = opacity[at_rest[1]].mean()
            print(
                f"{f'×{factor}, {length} length':32}{inside:10.4f}{psnr(color, at_rest[0]):10.2f}"
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("data_root", type=Path)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--size", type=int, help="longer side of the images")
    parser.add_argument("--pictures", type=Path, help="some renders beside the truth go there")
    arguments = parser.parse_args()
    start_warp()
    renderer = WayRenderer(modelfile.load(arguments.model), arguments.device)
    deformed = {
        name: load_dataset(arguments.data_root / name, "test", arguments.size) for name in MAPS
    }
    undeformed = load_dataset(arguments.data_root / "helmet", "test", arguments.size)
    names = deformed["helmet_twist"].names
    undeformed = subset(undeformed, [undeformed.names.index(name) for name in names])

    print(f"{'':32}" + "".join(f"{heading:>10}" for heading in HEADINGS))
    scores = measure(renderer, undeformed)
    iou = scores[0]
    print_row("undeformed", scores, iou)
    for data_name, dataset in deformed.items():
        vertices = mapped_vertices(renderer.field, MAPS[data_name])
        for way, (renderer.direction, renderer.length) in WAYS.items():
            renderer.set_vertices(vertices)
            pictures = None
            if arguments.pictures and way == "as defined":
                arguments.pictures.mkdir(parents=True, exist_ok=True)
                pictures = arguments.pictures / data_name
            print_row(f"{data_name}, {way}", measure(renderer, dataset, pictures), iou)
    print_squashes(renderer)


if __name__ == "__main__":
    main()
