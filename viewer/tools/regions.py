"""Tools that draw a box or a lasso: what is in it is selected, or deleted."""

from ..camera import project, within
from .deleting import Seen, said
from .keys import CTRL, SHIFT
from .tool import Tool

HOW = {0: "replace", SHIFT: "add", CTRL: "remove", SHIFT | CTRL: "intersect"}


class Region(Tool):
    """A tool that draws a `region`."""

    shape = "box"

    def press(self, pixel, modifiers) -> bool:
        self.mode, self.region = self.shape, [pixel, pixel]
        return True

    def move(self, before, pixel) -> bool:
        if self.shape == "box":
            self.region = [self.region[0], pixel]
        else:
            self.region.append(pixel)
        return True

    def end(self) -> None:
        self.mode, self.region = "", []

    @property
    def outline(self):
        """The pixels around it: a box's corners, or the lasso.  [K, 2]"""
        if self.shape == "lasso":
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


class SelectBox(SelectRegion):
    word = "Select"
    name, title, icon = "box", "Select in a box", "vector_square"


class SelectLasso(SelectRegion):
    word = "Lasso"
    name, title, icon, shape = "lasso", "Select in a lasso", "draw_polygon", "lasso"


class DeleteRegion(Region):
    """Deletes what is inside, all through; with Ctrl what is outside."""

    hint = "Draw around what is to go, all through.  Ctrl: around what stays.  Esc: back to Bend"

    def release(self, pixel, clicked, modifiers) -> None:
        cuts, others = self.scene.cuts, bool(modifiers & CTRL)
        seen = Seen(cuts.field, self.scene.positions, self.view.camera, None)
        chosen = seen.inside(self.outline)
        self.view.say(said(cuts, lambda: cuts.delete(seen.masks(chosen != others))))
        self.view.log("delete", left=int(cuts.kept.sum()))


class DeleteBox(DeleteRegion):
    word = "Cut box"
    name, title, icon = "delete box", "Delete in a box", "crop_simple"


class DeleteLasso(DeleteRegion):
    word = "Cut out"
    name, title, icon, shape = "delete lasso", "Delete in a lasso", "scissors", "lasso"
