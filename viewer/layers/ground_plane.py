"""The ground as it is seen: a plane with lines, and the object's shadow where it is near.

The shadow is a picture of the ground from above.  A point of the object darkens what is below
it, more the lower it is (a contact) and, more widely, up to about its own size (an ambient
shadow).  Points are the middles of sub-tets that can hold density, some thousands of them.
"""

from dataclasses import dataclass
from functools import cache

import moderngl
import numpy as np

from ...core.field import subtet_corners, unpack_mask
from ...core.geometry import EmbeddedPoints
from .drawn import DrawnObject

MOST_POINTS = 8_000
CELLS = 64  # a side of the shadow's picture
MARGIN = 0.35  # object sizes around the object that have shadow
CONTACT = 0.04, 3, 0.6  # height [object sizes], blur [cells], how dark at most
AMBIENT = 0.3, 9, 0.4
LINES = 5.0  # of the ground, about, over the length of the object
PLAIN_LENGTHS = 1.0, 2.0, 5.0  # times powers of ten: between two lines [m]


def occupied_middles(field) -> EmbeddedPoints:
    """The middles of a field's occupied sub-tets, at most MOST_POINTS, evenly chosen."""
    tet, subtet = np.nonzero(unpack_mask(field.occupancy))
    step = max(1, -(-len(tet) // MOST_POINTS))
    tet, subtet = tet[::step], subtet[::step]
    weights = subtet_corners().mean(axis=1).astype(np.float32)
    return EmbeddedPoints(field.mesh.tets[tet], weights[subtet])


@dataclass(frozen=True)
class Shadow:
    """A picture of a square of the ground: how much darker it is, rows along y."""

    shade: np.ndarray  # [CELLS, CELLS] in 0..1
    center: tuple[float, float]
    side: float  # of the square


def shadow(points, height: float, size: float) -> Shadow:
    """The shadow of points [N, 3] of an object of that size on the ground at z = height."""
    if not len(points) or not np.isfinite(points).all():
        return Shadow(np.zeros((CELLS, CELLS)), (0.0, 0.0), 1.0)
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    center, side = 0.5 * (low + high), float((high - low).max()) + 2.0 * MARGIN * size
    column, row = ((points[:, :2] - center) / side * CELLS + 0.5 * CELLS).astype(int).T
    lowest = np.full(CELLS * CELLS, np.inf, points.dtype)
    np.minimum.at(lowest, row * CELLS + column, np.maximum(points[:, 2] - height, 0.0) / size)
    lowest = lowest.reshape(CELLS, CELLS)
    for _ in range(2):  # the lowest of a cell and those around it: points are not in every cell
        padded = np.pad(lowest, ((1, 1), (0, 0)), mode="edge")
        lowest = np.minimum(np.minimum(padded[:-2], padded[2:]), lowest).T
    light = np.ones((CELLS, CELLS))
    for reach, blur, dark in (CONTACT, AMBIENT):
        light *= 1.0 - dark * _blurred(np.exp(-lowest / reach), blur)
    return Shadow(1.0 - light, (float(center[0]), float(center[1])), side)


def _blurred(picture, width: int):
    """Three running means of an odd width each way, about a Gaussian of σ = width / 2.

    Not a product of matrices: a BLAS that waits for all cores can take longer than a frame.
    """
    before, after = width // 2 + 1, width // 2
    for _ in range(3):
        for _ in range(2):
            sums = np.cumsum(np.pad(picture, ((before, after), (0, 0))), axis=0)
            picture = ((sums[width:] - sums[:-width]) / width).T
    return picture


@cache
def line_spacing(meters: float) -> float:
    """Meters between two lines of the ground under an object so long: 1, 2 or 5 · 10ⁿ."""
    wanted = max(meters, 1e-9) / LINES
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(plain for plain in PLAIN_LENGTHS if plain * power <= wanted))


class GroundPlane:
    """The ground of one object, as shaders/image.frag.glsl draws it."""

    def __init__(self, ctx: moderngl.Context, standing: DrawnObject):
        self._standing = standing
        # Middles of what is left of the object; pose, what is left, and height of the shadow.
        self._middles = self._shadow = self._seen = None
        self._texture = ctx.texture((CELLS, CELLS), 1)
        self._texture.repeat_x = self._texture.repeat_y = False

    def uniforms(self, unit: int) -> dict:
        """What the shader takes, with the shadow's texture in that unit; nothing without ground."""
        standing, cuts, settings = self._standing, self._standing.cuts, self._standing.settings
        height, shows = standing.solver.options.ground, settings.show_ground
        if height is None:
            height, shows = standing.floor, settings.show_floor
            shows = shows and standing.stands and standing.held
        if not shows:
            return {}
        if self._middles is None or self._seen[1] != cuts.revision:
            self._middles = occupied_middles(cuts.field)
            self._seen = None
        if self._seen != (standing.revision, cuts.revision, height):
            self._shadow = shadow(self._middles.points(standing.positions), height, standing.size)
            self._texture.write(np.round(255.0 * self._shadow.shade).astype(np.uint8).tobytes())
            self._seen = standing.revision, cuts.revision, height
        self._texture.use(unit)
        return {
            "ground_shadow": unit,
            "ground_height": height,
            "ground_middle": tuple(standing.center[:2]),
            "ground_reach": 2.5 * standing.size,
            "line_spacing": line_spacing(standing.body.meters) / standing.body.meters_per_unit,
            "shadow_center": self._shadow.center,
            "shadow_side": self._shadow.side,
        }

    def release(self) -> None:
        self._texture.release()
