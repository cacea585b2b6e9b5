"""What photographs mean: the thing that cameras look at, without what it stands or leans on.

A run that learned surroundings applies *Isolate* by itself where it is sure.  It is, if

    - the cameras' middles, as clicks, single out the same thing, but for a few of them;
    - what goes reaches the border of the box, or a flat part that goes on there: it has shown that
      it goes on, and hardly any of what stays does;
    - both are much more than a speck, and parted at a neck.

Shapes: N nodes of the matter's graph, C clicks.
"""

from dataclasses import dataclass

import numpy as np

from ..field import (
    Isolated,
    Isolation,
    Stroke,
    TetField,
    isolated,
    isolation_of,
    kept_field,
    neck_of,
)

CLICKS = 5  # cameras that click
AGREE, MOST = 0.95, 0.6  # IoU of what two clicks single out; share of the clicks that agree
STAYS, LEAST = 0.25, 0.02  # of the matter, that stays at least; that goes at least
AT_BORDER = 0.1  # of what is at the border, that stays at most
NECK = 1.5  # ties that are cut, over the root of the smaller side's matter


@dataclass(frozen=True)
class Meant:
    """What the photographs mean.

    Attributes:
        field: It alone.
        share: Of the matter, that was left out.
    """

    field: TetField
    share: float


def meant(field: TetField, poses: np.ndarray, place: np.ndarray) -> Meant | None:
    """The thing that cameras look at; None if there is nothing else, or that isn't sure.

    Args:
        field: With what surrounds the thing.
        poses: The cameras', in model space.  [C, 4, 4]
        place: Where they look, in model space.  [3]
    """
    if not field.occupancy.any():
        return None
    scene = isolation_of(field)
    if not scene.border.any() and not any(part.reason for draw in scene.draws for part in draw):
        return None  # nothing goes on beyond it
    chosen = np.unique(np.linspace(0, len(poses) - 1, CLICKS).astype(int))
    clicks = [click_of(scene, pose[:3, 3], place) for pose in poses[chosen]]
    results = [isolated(scene, [Stroke(click[None], this=True)]) for click in clicks]
    result = agreed(scene, results)
    if result is None or not is_sure(scene, result):
        return None
    gone = ~result.kept
    share = float(scene.weights[gone].sum() / scene.weights.sum())
    return Meant(kept_field(field, scene, result), share)


def click_of(scene: Isolation, eye: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Where the way from a camera to a place meets solid matter first, or what is nearest.  [3]"""
    from scipy.spatial import cKDTree

    matter = scene.matter
    solid = matter.middles[scene.opacity > 0.5 * scene.opacity.max()]
    steps = max(2, int(np.linalg.norm(place - eye) / (0.5 * matter.edge)))
    way = eye + np.linspace(0.0, 1.0, steps)[:, None] * (place - eye)
    away, nearest = cKDTree(solid).query(way)
    meets = np.flatnonzero(away < 0.75 * matter.edge)
    return solid[nearest[meets[0] if len(meets) else away.argmin()]]


def agreed(scene: Isolation, results: list[Isolated]) -> Isolated | None:
    """The result that agrees with the most of the others; None if these are too few."""
    weights = scene.weights
    agree = [
        np.mean([alike(weights, one.kept, other.kept) >= AGREE for other in results])
        for one in results
    ]
    best = int(np.argmax(agree))
    return results[best] if agree[best] >= MOST else None


def alike(weights: np.ndarray, one: np.ndarray, other: np.ndarray) -> float:
    """The IoU of two parts [N] bool of the matter."""
    return float(weights[one & other].sum() / max(weights[one | other].sum(), 1e-30))


def is_sure(scene: Isolation, result: Isolated) -> bool:
    """Whether what stays is a thing of its own, and what goes isn't."""
    gone = ~result.kept
    goes_on = any(part.reason for part in result.left_out)
    if not (goes_on or (scene.border & gone).any()):
        return False
    weights, kept = scene.weights, result.kept
    share = weights[kept].sum() / weights.sum()
    at_border = weights[scene.border & kept].sum()
    at_border /= max(weights[scene.border].sum(), 1e-30)
    neck = neck_of(scene, kept)
    return STAYS <= share <= 1.0 - LEAST and at_border <= AT_BORDER and neck <= NECK
