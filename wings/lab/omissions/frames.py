"""Omissions in rendering at rest, measured by rendering with the omitted part.

A turn renders one view with the part and once without; the next turn takes the next view.
Each variant has its own renderer: on CUDA a renderer predicts the number of rounds from its
last images, so the variants must not share it.  Images are compared over all views, over white.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from itertools import cycle
from typing import NamedTuple

import numpy as np

from ....core.field import (
    TetField,
    below_pixel,
    level_edges,
    multiplies_pairs,
    narrowest_pixel,
    occupied_share,
)
from ....core.render import Renderer, RenderOptions, default_stop, visible_part
from ..rendering.measure import FULL
from ..rendering.pictures import views
from .measure import Switch, image_change


class Way(NamedTuple):
    """One variant of rendering."""

    renderer: Renderer | None  # None if nothing is rendered
    turn: Callable[[], object]  # renders the next view
    images: Callable[[], list]  # of all views: [H, W, 4] uint8 each


class Frames:
    """Variants of rendering a field at rest."""

    def __init__(self, field: TetField, device, size: int, view_count: int):
        self.field, self.device = field, device
        self.cameras = views(field, view_count, size)

    @cached_property
    def usual(self) -> Way:
        """The field as it is, in default mode."""
        return self.way()

    def way(self, field: TetField | None = None, part_of=visible_part, **options) -> Way:
        """A variant with another field of the same mesh, other tets, or other RenderOptions."""
        renderer = Renderer(field or self.field, self.device, part_of)
        renderer.set_vertices(self.field.mesh.rest_vertices)
        options, following = RenderOptions(**options), cycle(self.cameras)
        return Way(
            renderer,
            lambda: renderer.render(next(following), options),
            lambda: [renderer.render(c, options).color_array() for c in self.cameras],
        )

    def change(self, with_it: Way, without: Way) -> str:
        """The difference of their images, in words."""
        return image_change(with_it.images(), without.images())

    def change_of_layers(self, layers: Way, usual: Way) -> str:
        """Compare with rays without an early end, too, because the path for overlap has none."""
        endless = self.change(layers, self.way(termination=0.0))
        return f"{self.change(layers, usual)}; compared with rays that never end: {endless}"

    def waiting(self):
        """The way of rounds that the host waits for."""
        return self.way(path="host")

    def again(self) -> list:
        """The first view, once more."""
        return [self.usual.renderer.render(self.cameras[0]).color_array()]


def frame_switches(frames: Frames) -> list[Switch]:
    """The switches that can be measured on the device of the frames."""
    field, way = frames.field, frames.way

    def usual():
        return frames.usual

    def to_the_last_slot():
        one = way()
        one.renderer.shading.densities.zero_()
        return one

    filled = np.where(field.occupancy == 0, field.occupancy, FULL)
    empty_subtets = 100.0 * (1.0 - occupied_share(visible_part(field)[0].occupancy))
    empty_tets = 100.0 * (field.occupancy == 0).mean()
    spent = 100.0 - 100.0 * default_stop(field.options.deferred)
    switches = [
        Switch(
            "samples in empty sub-tets",
            lambda: way(replace(field, occupancy=filled)),
            usual,
            f"{empty_subtets:.0f} % of the sub-tets of the tets that rays cross are empty. The"
            " density there was never trained: it would be seen, and it would end rays early.",
        ),
        Switch(
            "tets without density on a ray's way",
            lambda: way(part_of=every_tet),
            usual,
            f"{empty_tets:.0f} % of the tets serve the dynamics alone; they are removed once, when"
            " a model is loaded.",
        ),
        Switch(
            "samples behind what is opaque",
            lambda: way(termination=0.0),
            usual,
            f"A ray ends once {spent:g} % of it is spent; what is behind is taken"
            " to look like what is before. The test is one comparison a sample.",
        ),
        Switch(
            "samples where a ray is expected to be opaque",
            to_the_last_slot,
            usual,
            "Densities in the middles of sub-tets, found when a model is loaded, tell how far a"
            " round goes; a ray that is still transparent there goes on in the next one.",
        ),
        Switch(
            "the path for overlap, at rest",
            lambda: way(path="merge"),
            usual,
            "Nothing overlaps at rest, which is tested once a pose, so no ray has to sort media"
            " or store its pieces.",
            change=frames.change_of_layers,
        ),
        _precision_switch(frames),
        Switch(
            "rounds that the host waits for",
            frames.waiting,
            usual,
            "The device knows how many rays go on; an image is one CUDA graph.",
        ),
        Switch(
            "rendering again what did not change",
            lambda: Way(frames.usual.renderer, frames.again, frames.again),
            lambda: Way(None, lambda: None, frames.again),
            "Neither camera nor vertices changed, so the same image would come out.",
        ),
        _level_switch(frames),
        _view_switch(frames),
    ]
    if frames.device == "cpu":  # nothing waits
        return switches[: 6 if multiplies_pairs() else 5] + switches[7:]
    return switches[:3] + switches[4:]  # no ray is expected to be opaque


def _precision_switch(frames):
    """A switch for half precision: float16 on CUDA, bfloat16 on processors that multiply it."""
    if frames.device == "cpu":
        return Switch(
            "single precision of networks",
            lambda: frames.way(single_precision=True),
            lambda: frames.usual,
            "The processor multiplies a pair of bfloat16 in the time of one float32.",
        )
    return Switch(
        "single precision of networks and tables",
        lambda: frames.way(single_precision=True),
        frames.waiting,  # float32 runs in rounds that the host waits for
        "Half precision uses tensor cores and half the bytes, and needs no torch; it counts"
        " in large images.",
    )


def _level_switch(frames):
    """A switch for the levels finer than a pixel or, if there are none, for the finest level."""
    field, count = frames.field, frames.field.layout.level_count
    positions, focal = [c.position for c in frames.cameras], frames.cameras[0].focal
    pixel = narrowest_pixel(positions, focal, field.mesh.rest_vertices)
    edges = level_edges(field.mesh, count)
    finer = int(below_pixel(edges, pixel).sum())
    finest = edges[-1] / pixel
    what = f"no level is finer than a pixel of this view (the finest has edges of {finest:.1f})"
    if finer:
        what = f"{finer} of {count} levels are finer than a pixel of this view"
    return Switch(
        "levels finer than a pixel" if finer else "the finest level",
        lambda: frames.usual,
        lambda: frames.way(level_count=max(1, count - max(finer, 1))),
        f"It is kept: {what}, and networks trained with all levels are wrong without one.",
        left_out=False,
    )


def _view_switch(frames):
    """A switch for spherical harmonics of the direction; some models are trained without."""
    field, has_it = frames.field, frames.field.options.view_dependence
    other = replace(field, options=replace(field.options, view_dependence=not has_it))
    return Switch(
        "view dependence",
        lambda: frames.usual if has_it else frames.way(other),
        lambda: frames.way(other) if has_it else frames.usual,
        "It is kept: the model was trained with it, and its colors are off without."
        if has_it
        else "The model was trained without it, and its colors depend on no direction.",
        left_out=not has_it,
    )


def every_tet(field: TetField):
    """All tets, in the order of visible_part."""
    part, ids = visible_part(replace(field, occupancy=np.full_like(field.occupancy, FULL)))
    return replace(part, occupancy=field.occupancy[ids]), ids
