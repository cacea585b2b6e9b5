"""A film's camera with the lens of a photograph.

An Orbit has a vertical field of view alone.  A photograph's lens has two focal lengths, an axis
beside the middle of the image, and distortion; a Sight has these as well, in shares of the image's
height, so that a film may have another size.  What lies between two keys is interpolated.
"""

import math
from dataclasses import dataclass, field, fields, replace

import numpy as np

from ...core.render import Camera, Lens, has_rays
from ..camera import Orbit, camera_of


@dataclass(frozen=True)
class Sight(Orbit):
    """An orbit, and how its lens differs from a pinhole behind the middle of the image."""

    stretch: float = 1.0  # horizontal over vertical focal length
    shift: np.ndarray = field(default_factory=lambda: np.zeros(2))  # of the axis [image heights]
    distortion: np.ndarray = field(default_factory=lambda: np.zeros(6))  # k1, k2, k3, k4, p1, p2


def sight_of(orbit: Orbit, lens: Lens) -> Sight:
    """An orbit's direction of view, with a photograph's lens."""
    (fx, fy), (cx, cy), size = lens.focal, lens.center, np.array([lens.width, lens.height])
    return Sight(
        **_values(orbit) | {"field_of_view": 2.0 * math.atan(0.5 * lens.height / fy)},
        stretch=fx / fy,
        shift=(np.array([cx, cy]) - 0.5 * size) / lens.height,
        distortion=np.array([*lens.radial, *lens.tangential]),
    )


def seen_by(orbit: Orbit, width: int, height: int) -> Camera:
    """The camera of an image; the vertical field of view is the orbit's, whatever its width."""
    camera = camera_of(orbit, width, height)
    if not isinstance(orbit, Sight):
        return camera
    focal, distortion = camera.lens.focal[1], orbit.distortion.tolist()
    center = 0.5 * np.array([width, height]) + orbit.shift * height
    both = {"focal": (orbit.stretch * focal, focal), "center": tuple(center.tolist())}
    bent = {"radial": tuple(distortion[:4]), "tangential": tuple(distortion[4:])}
    return replace(camera, lens=replace(camera.lens, **both, **bent))


def without_lens(orbit: Orbit) -> Orbit:
    """The same direction and field of view, as scenes and sessions have them."""
    return Orbit(**_values(orbit))


def fit(sights: list[Sight], size=None):
    """Sights that a film of a size can show, and a sentence if it can't show all of their lenses.

    A film that is wider than the photographs may show more than the distortion is made for: there
    it turns back, and pixels have no rays.
    """
    lenses = [seen_by(sight, *size).lens for sight in sights if sight.distortion.any() and size]
    if all(map(has_rays, dict.fromkeys(lenses))):
        return sights, ""
    straight = [replace(sight, distortion=np.zeros(6)) for sight in sights]
    return straight, (
        f"the film of {size[0]}x{size[1]} pixels shows more at its borders than the photographs, "
        f"and their lens's distortion has no rays there: the film is made without distortion"
    )


def _values(orbit):
    return {one.name: getattr(orbit, one.name) for one in fields(Orbit)}
