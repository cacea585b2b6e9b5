"""What photographs saw of an object: marks on the rest of its surface.

Colors and angles are those of the sphere on a check's page; what is seen well has no mark.

    surface   sub-tets that a ray hits first, from one of many directions around the object
    angle     between the way a sub-tet is looked at and the nearest photograph that saw it: that
              had it in its picture, and nothing before it

A pose turns ways of looking back to rest.  Pictures of depth are rendered one after another,
between frames.

Shapes: S sub-tets of the surface, v photographs.
"""

import time

import numpy as np

from ...core.field import subtet_corners, unpack_mask
from ...core.geometry import EmbeddedPoints
from ...core.render import Renderer, from_field_of_view, look_at, views_of_rows
from ..camera import visible
from .drawn import DrawnObject
from .handle_layer import MOST_MARKS

NEAR, FAR = 20.0, 45.0  # degrees
HARDLY, MISSED = (250, 222, 112), (166, 54, 10)  # colors of angles from NEAR, and from FAR
PROBES, PIXELS = 40, 96  # directions around; across a picture of depth
VIEWS = 100  # photographs at most, spread evenly
APART = 2.5  # object sizes from a probe's eye to the middle
# Edges above and below where a ray ends, that are the surface; below, that it saw: a ray that is
# nearly along the surface ends before it.
SURFACE, SAW = 1.0, 2.5
SLICE = 0.05  # s of a frame
STRIPE = 20.0  # edges from one dark stripe to the next


class Photographed:
    """What photographs saw of one object."""

    def __init__(self, drawn: DrawnObject, device):
        self._drawn, self._device = drawn, device
        self._revision = self._work = None
        self.progress = 0.0

    def marks(self, camera):
        """Places [n, 3], tints [n, 3] and radius of marks on what is not seen well from where a
        camera is; None as long as they are found out.
        """
        self.work()
        if self.busy:
            return None
        positions, middles = self._drawn.positions, self._middles
        rest = self._drawn.field.mesh.rest_vertices
        places = middles.points(positions)
        ways = camera.position - places
        if camera.parallel:
            ways[:] = -camera.forward
        ways = at_rest(ways, positions[middles.corners], rest[middles.corners])
        cosines = np.einsum("vsx,sx->vs", self._seen, ways.astype(np.float32)).max(axis=0)
        angles = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))[:, None]
        dark = (middles.points(rest).sum(axis=1) / (STRIPE * self._edge) % 1.0 < 0.5)[:, None]
        tints = np.where(angles > FAR, np.where(dark, 0.5, 1.0) * np.array(MISSED), HARDLY) / 255.0
        marked = angles[:, 0] > NEAR
        return places[marked], tints[marked], 0.4 * self._edge

    def work(self) -> None:
        """Find out a part of it, if anything is to be found out."""
        if self._revision != self._drawn.cuts.revision:
            self._revision, self._work = self._drawn.cuts.revision, self._find()
        end = time.perf_counter() + SLICE
        while self._work is not None and time.perf_counter() < end:
            self.progress = next(self._work, None)
            if self.progress is None:
                self._work = None

    def leave(self) -> None:
        """Give up what is being found out, with its renderer: `work` begins anew."""
        if self._work is not None:
            self._revision = self._work = None

    @property
    def busy(self) -> bool:
        return self._work is not None

    @property
    def told(self) -> str:
        """What the colors mean, or how far the work is."""
        if self.busy:
            return f"looking from the photographs, {self.progress or 0.0:.0%}"
        return f"yellow: no photograph within {NEAR:.0f}° of this view; red: none within {FAR:.0f}°"

    def _find(self):
        """Find the surface, and from where each part of it was photographed; yield the share."""
        drawn, field = self._drawn, self._drawn.field
        mesh, views = field.mesh, views_of_rows(field.meta["views"], PIXELS)
        views = views[:: 1 + len(views) // VIEWS]
        renderer, total = Renderer(field, self._device), PROBES + len(views)
        renderer.set_vertices(mesh.rest_vertices)
        renderer.set_occupancy(drawn.cuts.left)
        tets, subtets = np.nonzero(unpack_mask(drawn.cuts.left))
        all_ = EmbeddedPoints(mesh.tets[tets], subtet_corners().mean(axis=1)[subtets])
        middles = all_.points(mesh.rest_vertices)
        sides = mesh.rest_vertices[all_.corners[:, 1]] - mesh.rest_vertices[all_.corners[:, 0]]
        self._edge = float(np.linalg.norm(sides, axis=1).mean()) / 4.0
        thick, surface = SURFACE * self._edge, np.zeros(len(tets), bool)
        for number, camera in enumerate(probes(drawn.center, drawn.size)):
            depth = renderer.render(camera).depth_array()
            hit = visible(camera, middles, depth, thick)
            surface |= hit & ~visible(camera, middles, depth, -thick)  # fog is before it
            yield number / total
        chosen = np.flatnonzero(surface)
        chosen = chosen[:: 1 + len(chosen) // MOST_MARKS]
        self._middles = EmbeddedPoints(all_.corners[chosen], all_.weights[chosen])
        places = middles[chosen]
        self._seen = np.zeros((1 + len(views), len(chosen), 3), np.float32)
        renderer.set_occupancy(field.occupancy)  # what has been cut off since was in the pictures
        for number, camera in enumerate(views):
            hit = visible(camera, places, renderer.render(camera).depth_array(), SAW * self._edge)
            ways = camera.position - places
            ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-12)
            self._seen[number] = np.where(hit[:, None], ways, 0.0)
            yield (PROBES + number) / total


def probes(center, size: float):
    """Cameras that look at an object from all around."""
    for number in range(PROBES):
        z, turn = 1.0 - (2.0 * number + 1.0) / PROBES, np.pi * (3.0 - np.sqrt(5.0)) * number
        x, y = np.sqrt(1.0 - z * z) * np.array([np.cos(turn), np.sin(turn)])
        eye = center + APART * size * np.array([x, y, z])
        yield from_field_of_view(look_at(eye, center), 2.0 * np.arctan(0.6 / APART), PIXELS, PIXELS)


def at_rest(ways, now, rest):
    """Directions [S, 3] in tets with corners [S, 4, 3] now, as unit vectors where these rest."""
    edges, rest_edges = (np.swapaxes(c[:, 1:] - c[:, :1], 1, 2) for c in (now, rest))
    shares = np.linalg.solve(edges + 1e-12 * np.eye(3), ways[..., None])
    turned = (rest_edges @ shares)[..., 0]
    return turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12)
