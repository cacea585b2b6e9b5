"""Find the object in the first seconds of a run that has no box for it.

The search (data/found_object.py) needs points on surfaces.  It first takes those that came with the
cameras.  If there are none, or they show no object, a coarse field is trained on everything around
the place that the cameras look at; the depths of random training rays in it give the points.
If these show no object either, the run keeps its scene box.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
import warp as wp

from ..geometry import Plane, a15_grid
from .data.datasets import Dataset
from .data.found_object import FoundObject, find_object, ground_of
from .data.raybank import RayBank
from .data.scene_box import REACH, box_to_unit_cube, found_to_unit_cube
from .data.views import focus
from .run.batch import looks
from .run.distributed import Workers
from .run.optimization import Optimization
from .run.surroundings import LearnedSurroundings, random_surroundings
from .run.training_field import TrainingField
from .stages import FINAL_RATES, coarse_options
from .train_options import preset

WIDER = 1.5  # than the box that the cameras look at: the table's plane is seen, and what's on it
STEPS = 150
LOOK_RAYS, LOOK_SIZE = 1 << 16, 1 << 12  # whose depths are taken, and as many at once
HALF = 0.5  # of a ray's light: where it has ended
# How far the ground may be from where points of structure from motion, or a field's fog, have it.
POINTS_SLACK, FIELD_SLACK = 0.04, 0.1  # [model units]
AROUND = 0.05  # of the box: rays that pass there are learned from [model units]
NOT_FOUND = (
    "No object was found that stands on a plane or hangs on one, so all that lies where the "
    "cameras look is trained; --aabb gives the object's box."
)


@dataclass(frozen=True)
class FoundBox:
    """The object's box, found.

    Attributes:
        box: In model space, on z = 0.  [2, 3]
        stands: Whether the object stands on a plane below it, or hangs on one at its largest y.
        slack: How far the plane's surface may be from the box's face [model units].
    """

    box: np.ndarray
    stands: bool
    slack: float = FIELD_SLACK

    @staticmethod
    def of_report(report: dict) -> "FoundBox | None":
        """What `as_report` wrote into the report of a run."""
        if "object_box" not in report:
            return None
        stands, slack = report["object_stands"], report["object_slack"]
        return FoundBox(np.array(report["object_box"]), bool(stands), float(slack))

    def as_report(self) -> dict:
        return {
            "object_box": self.box.tolist(),
            "object_stands": self.stands,
            "object_slack": self.slack,
        }

    @property
    def plane(self) -> Plane:
        """What it stands or hangs on, in model space: a face of the box."""
        if self.stands:
            return Plane(np.array([0.0, 0.0, 1.0]), self.box[0, 2])
        return Plane(np.array([0.0, -1.0, 0.0]), -self.box[1, 1])

    @property
    def space(self):
        """Where matter may be: the box, and all behind the plane, where its surface is.  [2, 3]"""
        space = self.box.copy()
        space[(0, 2) if self.stands else (1, 1)] -= self.plane.normal.sum()
        return space

    @property
    def seen(self):
        """The space whose rays are learned from.  [2, 3]"""
        return self.box + np.array([[-AROUND], [AROUND]])


def search(dataset: Dataset, seed: int, device, workers: Workers, progress):
    """Look for the object in photographs, and say what was found.

    Args:
        seed: Of the run.
        progress: A TrainingProgress.

    Returns:
        What was found, None if it isn't clear; and the similarity that takes it upright into the
        unit cube.  FoundBox, [4, 4]
    """
    found, slack = None, POINTS_SLACK
    if dataset.points is not None:
        found = find_among(dataset, dataset.points)
    if found is None:
        slack = FIELD_SLACK
        found = found_by_a_field(dataset, seed, device, workers, progress)
    progress.say(said(found) if found else NOT_FOUND)
    if found is None:
        return None, None
    world_to_model, box = found_to_unit_cube(found)
    return FoundBox(box, found.stands, slack), world_to_model


def find_among(dataset: Dataset, points) -> FoundObject | None:
    """The object among points; masks, if the data set has such, vote on it."""
    masks = (lambda view: dataset.image(view)[..., 3]) if dataset.masked else None
    return find_object(points, dataset.poses, dataset.lenses, masks)


def found_by_a_field(dataset, seed, device, workers, progress) -> FoundObject | None:
    """The object, found among the depths of a coarse field."""
    center = focus(dataset.poses)
    half = WIDER * REACH * np.median(np.linalg.norm(dataset.poses[:, :3, 3] - center, axis=1))
    whole = box_to_unit_cube([center - half, center + half], "the box around all")
    photographs = dataset
    if dataset.masked:  # the table is needed as well
        pixels = dataset.pixels.copy()
        pixels[:, 3] = 255
        photographs = replace(dataset, pixels=pixels)
    points = coarse_points(photographs, whole, seed, device, workers, progress)
    return first_workers(find_among(dataset, points), device, workers)


def first_workers(found: FoundObject | None, device, workers: Workers) -> FoundObject | None:
    """What the first worker has found: others may have rounded differently."""
    values = torch.zeros(17, dtype=torch.float64)
    if found is not None:
        numbers = found.turn.ravel(), found.box.ravel(), [found.stands, 1.0]
        values = torch.from_numpy(np.concatenate(numbers))
    values = values.to(wp.device_to_torch(device))
    workers.broadcast_(values)
    turn, box, (stands, is_found) = np.split(values.cpu().numpy(), [9, 15])
    if workers.is_first or not is_found:
        return found if is_found else None
    return FoundObject(turn.reshape(3, 3), box.reshape(2, 3), bool(stands))


def said(found: FoundObject) -> str:
    """Sentences about a found object and what is left out, with the --aabb around each."""
    corners = np.stack(np.meshgrid(*found.box.T), axis=-1).reshape(-1, 3) @ found.turn
    around = numbers(corners.min(axis=0), corners.max(axis=0))
    size = " x ".join(f"{v:.3g}" for v in found.box[1] - found.box[0])
    where = "stands on a plane" if found.stands else "hangs on a plane behind it"
    text = (
        f"Found an object that {where}, in a box of {size} of the data's units, about --aabb "
        f"{around}: give another box if this is not the object."
    )
    if found.others:
        count = len(found.others)
        things = "Another thing" if count == 1 else f"{count} other things"
        text += (
            f" {things} beside it will be left out"
            + ("" if count == 1 else ", the one that is looked at most")
            + f" at about --aabb {numbers(*found.others[0])}."
        )
    return text


def numbers(low, high) -> str:
    """A box, as --aabb takes it."""
    return " ".join(f"{value:.3g}" for value in (*low, *high))


def coarse_points(dataset, world_to_model, seed, device, workers, progress):
    """Where random training rays end in a coarse field of all that lies in the unit cube.

    In the data's space.  [n, 3]
    """
    options = preset("tiny", seed=seed)
    bank = RayBank(dataset, world_to_model, device)
    cube = np.array([[0.0] * 3, [1.0] * 3])
    around = LearnedSurroundings(random_surroundings(cube, seed), device)
    coarse = replace(coarse_options(options), view_dependence=False)
    mesh = a15_grid(options.spacing)
    field = TrainingField(mesh, coarse, device, seed, around, workers=workers)
    optimization = Optimization(field, bank, options, False, STEPS, FINAL_RATES[1])
    optimization.run(progress, "finding the object")
    field.update_occupancy()
    inverse = np.linalg.inv(world_to_model)
    return surface_points(field, bank) @ inverse[:3, :3].T + inverse[:3, 3]


def ground_under(found: FoundBox, field: TrainingField, bank: RayBank, workers: Workers) -> Plane:
    """The plane that a found object stands or hangs on, where a field of it has the surface."""
    ground = ground_of(surface_points(field, bank), found.plane, found.slack)
    values = torch.tensor([*ground.normal, ground.offset], dtype=torch.float64)
    values = values.to(field.torch_device)
    workers.broadcast_(values)
    *normal, offset = values.tolist()
    return Plane(np.array(normal), offset)


@torch.no_grad()
def surface_points(field: TrainingField, bank: RayBank):
    """Where random training rays end in a field, in model space.  [n, 3]"""
    points = []
    for number, batch in enumerate(looks(bank, field.device, LOOK_RAYS, LOOK_SIZE), start=1):
        batch.seed.fill_(number)
        field.march(batch)
        points.append(ends_of_rays(batch, field.composite(batch).weights).cpu().numpy())
    return np.concatenate(points)


def ends_of_rays(batch, weights):
    """Where half of a ray's light is gone; rays that keep more have no end.  torch [n, 3]"""
    counts, ends = (wp.to_torch(a).long() for a in (batch.counts, batch.ends))
    rays = torch.repeat_interleave(torch.arange(len(counts), device=counts.device), counts)
    sums = torch.cumsum(weights.double(), 0)
    before = torch.cat([sums.new_zeros(1), sums])[ends - counts]
    places = torch.arange(len(weights), device=counts.device)
    past = (sums - before[rays]) >= HALF
    first = torch.full_like(counts, len(weights))
    first.scatter_reduce_(0, rays[past], places[past], "amin")
    ended = first < len(weights)
    t = wp.to_torch(batch.samples.t)[first[ended]]
    return batch.origins[ended] + t[:, None] * batch.directions[ended]
