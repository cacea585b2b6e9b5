"""Tools that act on what the mouse passes: they push it, make it stiffer or softer, or delete."""

import numpy as np

from ..camera import onto_view_plane, project, ray
from .deleting import BRUSH, Seen, said
from .keys import SHIFT
from .tool import Tool

BRUSH_RADII = 4.0, 300.0  # points
WIDER_PER_NOTCH = 1.15  # of the brush
PAUSED_BALL = "paused: the ball pushes when time goes on (Space), or by a step (.)"


class Push(Tool):
    """A ball on the surface under the mouse pushes the object."""

    word = "Push"
    name, title, icon = "push", "Push with a ball", "bowling_ball"
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
    factor = 1.2  # at each event of the mouse

    def press(self, pixel, modifiers) -> bool:
        self.mode = "paint"
        return self.move(pixel, pixel)

    def move(self, before, pixel) -> bool:
        point = self.view.surface_at(pixel, beside=False)
        if point is not None:
            self.scene.paint(point, self.factor)
        return True

    def release(self, pixel, clicked, modifiers) -> None:
        self.view.log("paint", factors=self.scene.body.factors is not None)


class Stiffen(Paint):
    word = "Stiffen"
    name, title, icon = "stiffen", "Stiffen", "gem"
    hint = "Drag over the object: it gets stiffer there.  Esc: back to Bend"


class Soften(Paint):
    word = "Soften"
    name, title, icon, factor = "soften", "Soften", "feather", 1.0 / 1.2
    hint = "Drag over the object: it gets softer there.  Esc: back to Bend"


class DeleteBrush(Tool):
    """Deletes what is under the brush, one layer a stroke; beside the object the drag orbits."""

    word = "Erase"
    name, title, icon = BRUSH, "Delete with a brush", "eraser"
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
