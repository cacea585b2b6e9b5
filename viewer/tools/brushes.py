"""Tools that act on what the mouse passes or draws around: they push, stiffen, select or delete.

A stroke of the brush that deletes goes by the view in which it began: it takes what was in front
then, down to a depth below the surface, so that each stroke takes one layer.  Pixels are the
image's, x to the right, y down.

Shapes: N sub-tets that are left.
"""

import numpy as np

from ...core.field import subtet_middles, unpack_mask
from ..camera import away_from_lines, depth_at, onto_view_plane, project, ray, within
from ..document import masks_of
from ..settings import DELETING
from .keys import CTRL, SHIFT
from .tool import Tool

BRUSH = DELETING[0]
LAYER = 0.5  # edges of a tet, that a stroke takes below the surface
BRUSH_RADII = 4.0, 300.0  # points
WIDER_PER_NOTCH = 1.15  # of the brush
HOW = {0: "replace", SHIFT: "add", CTRL: "remove", SHIFT | CTRL: "intersect"}
PAINT = {"stiffen": (1.2, "stiffer"), "soften": (1.0 / 1.2, "softer")}  # at each move
PAUSED_BALL = "paused: the ball pushes when time goes on (Space), or by a step (.)"


class Push(Tool):
    """A ball on the surface under the mouse pushes the object."""

    hint = "Drag: a ball pushes the object.  Esc: back to Bend"

    _miss = None  # from the center of the ball to the press  [2]

    def press(self, pixel, modifiers) -> bool:
        scene, point = self.scene, self.view.surface_at(pixel)
        if scene.timeline.stands:  # at a pose of the timeline: a hand lets time go on
            scene.clock.paused = False
        if scene.clock.paused:
            self.view.say(PAUSED_BALL)
        scene.push(point, -ray(self.view.camera, pixel)[1])
        (center,), _ = project(self.view.camera, scene.ball.target[None])
        self._miss, self.mode = pixel - center, "push"
        self.view.log("push", position=scene.ball.target)
        return True

    def move(self, before, pixel) -> bool:
        ball = self.scene.ball
        if ball is not None:
            place = onto_view_plane(self.view.camera, pixel - self._miss, ball.target)
            self.scene.push_to(place)
        return True

    def release(self, pixel, clicked, modifiers) -> None:
        self.scene.end_push()
        self.view.log("end_push")

    def cancel(self) -> None:
        self.scene.end_push()


class Paint(Tool):
    """Changes the stiffness of what the mouse passes, within the grab radius."""

    can_cancel = False

    @property
    def hint(self):
        return f"Drag over the object: it gets {PAINT[self.name][1]} there.  Esc: back to Bend"

    def press(self, pixel, modifiers) -> bool:
        self.mode = "paint"
        return self.move(pixel, pixel)

    def move(self, before, pixel) -> bool:
        point = self.view.surface_at(pixel, beside=False)
        if point is not None:
            self.scene.paint(point, PAINT[self.name][0])
        return True

    def release(self, pixel, clicked, modifiers) -> None:
        self.view.log("paint", factors=self.scene.body.factors is not None)


class Seen:
    """The occupied sub-tets of a field, as a camera sees them."""

    def __init__(self, field, positions, camera, depth_image):
        """Take where its vertices are [V, 3], and the depths of the picture or None."""
        self._count = field.mesh.tet_count
        occupied = unpack_mask(field.occupancy)
        self.tets, self.subtets = np.nonzero(occupied)
        middles = subtet_middles(field.mesh, positions)[occupied]
        self.pixels, self._away = project(camera, middles)
        corners = positions[field.mesh.tets]
        edge = float(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).mean())
        surface = np.full(len(middles), np.inf)
        if depth_image is not None:
            surface = depth_at(depth_image, camera, np.nan_to_num(self.pixels, nan=-1.0))
        self.in_front = self._away <= surface + LAYER * edge
        self.in_front &= self._away > 0.0

    def near(self, start, end, radius: float):
        """Which are within a radius [pixels] of the way from one pixel to another.  ids"""
        start, end = np.asarray(start, float), np.asarray(end, float)
        low, high = np.minimum(start, end) - radius, np.maximum(start, end) + radius
        x, y = self.pixels.T
        ids = np.flatnonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))
        return ids[away_from_lines(self.pixels[ids], start, end) <= radius]

    def inside(self, outline):
        """Which are inside a closed outline of pixels [K, 2], in the view.  [N] bool"""
        return within(np.nan_to_num(self.pixels, nan=-1e9), outline) & (self._away > 0.0)

    def masks(self, chosen):
        """These, ids or [N] bool, as masks.  [T] uint64"""
        return masks_of(self.tets[chosen], self.subtets[chosen], self._count)


def said(cuts, delete) -> str:
    """Call a function that deletes, and say what came of it."""
    pins = cuts.state()["pins"]
    try:
        if not delete():
            return "nothing to delete there"
    except ValueError as error:  # nothing would be left
        return str(error)
    line = f"{int(cuts.kept.sum()):,} of {len(cuts.kept):,} tets are left"
    if cuts.state()["pins"] is not pins:
        line += "; its pins were deleted: now its lowest part is pinned"
    return line


def found_box(field):
    """The box that training found around a field's object, at rest; None without one.  [2, 3]"""
    box = field.meta.get("object_box")
    return None if box is None else np.array(box, float)


class DeleteBrush(Tool):
    """Deletes what is under the brush, one layer a stroke; beside the object the drag orbits."""

    hint = (
        "Drag over what is to go, a layer a stroke.  Shift: all through.  Wheel: size.  Esc: back"
    )

    _seen: Seen | None = None  # what there was as the stroke began
    _through = False  # whether it takes all that is behind, too
    _taken = _masks = None  # so far: whether of each sub-tet that was seen, and as masks

    @property
    def radius(self) -> float:
        """Of the brush [pixels]."""
        return self.scene.settings.brush_radius * self.view.ratio

    def press(self, pixel, modifiers) -> bool:
        scene, view = self.scene, self.view
        seen = Seen(scene.cuts.field, scene.positions, view.camera, view.depth_image())
        if not len(seen.near(pixel, pixel, self.radius)):
            return False
        self._seen, self._through, self.mode = seen, bool(modifiers & SHIFT), "delete"
        self._taken, self._masks = np.zeros(len(seen.tets), bool), np.uint64(0)
        return self.move(pixel, pixel)

    def move(self, before, pixel) -> bool:
        under = self._seen.near(before, pixel, self.radius)
        under = under[~self._taken[under] & (self._through | self._seen.in_front[under])]
        if len(under):
            self._taken[under] = True
            self._masks = self._masks | self._seen.masks(under)
            self.scene.cuts.show_preview(self._masks)
        return True

    def release(self, pixel, clicked, modifiers) -> None:
        cuts = self.scene.cuts
        self.view.say(said(cuts, cuts.keep_preview))
        self.view.log("delete", left=int(cuts.kept.sum()))

    def wheel(self, notches) -> bool:
        settings = self.scene.settings
        radius = settings.brush_radius * WIDER_PER_NOTCH**notches
        settings.brush_radius = float(np.clip(radius, *BRUSH_RADII))
        return True

    def cancel(self) -> None:
        self.scene.cuts.show_preview(None)

    def end(self) -> None:
        self.mode, self._seen = "", None


class Region(Tool):
    """A tool that draws a `region`: a box or a lasso, as its name ends."""

    def press(self, pixel, modifiers) -> bool:
        self.mode, self.region = self.name.split()[-1], [pixel, pixel]
        return True

    def move(self, before, pixel) -> bool:
        if self.mode == "box":
            self.region = [self.region[0], pixel]
        else:
            self.region.append(pixel)
        return True

    def end(self) -> None:
        self.mode, self.region = "", []

    @property
    def outline(self):
        """The pixels around it: a box's corners, or the lasso.  [K, 2]"""
        if self.mode == "lasso":
            return self.region
        (x0, y0), (x1, y1) = self.region
        return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


class SelectRegion(Region):
    """Selects the red points in sight that are inside; then bends again."""

    hint = "Draw around red points.  Shift adds, Ctrl removes, both intersect.  Esc: back to Bend"

    def release(self, pixel, clicked, modifiers) -> None:
        handles, ids = self.handles, self.handles.control_ids
        pixels, _ = project(self.view.camera, handles.at(ids))
        inside = self.view.shown(ids) & within(pixels, self.outline)
        handles.select(ids[inside], HOW[modifiers & (SHIFT | CTRL)])
        self.scene.settings.tool = "grab"
        self.view.log("select", vertices=handles.selected)


class DeleteRegion(Region):
    """Deletes what is inside, all through; with Ctrl what is outside."""

    hint = "Draw around what is to go, all through.  Ctrl: around what stays.  Esc: back to Bend"

    def release(self, pixel, clicked, modifiers) -> None:
        cuts, others = self.scene.cuts, bool(modifiers & CTRL)
        seen = Seen(cuts.field, self.scene.positions, self.view.camera, None)
        chosen = seen.inside(self.outline)
        self.view.say(said(cuts, lambda: cuts.delete(seen.masks(chosen != others))))
        self.view.log("delete", left=int(cuts.kept.sum()))
