"""The tool that singles out one thing: a click on it, strokes for "this" and "not this", a cut.

What strokes mean is core/field/isolation's; their points are kept at rest, so that a bent object
can be worked on.  The preview marks sub-tets in two colors.  The cut is a deletion like any other:
sessions have it, and it can be undone.

Shapes: T tets, N occupied sub-tets, n of them that are marked.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from ...core import field as fields
from ...core.field import subtet_corners, subtet_middles, unpack_mask
from .deleting import said
from .keys import SHIFT
from .tool import Tool

BRUSH = 4.0  # points: half the width of a stroke
SOLID, MARKS_MAX = 0.3, 12_000  # opacity of sub-tets that are marked, and how many at most
NEEDS_SCIPY = "this needs the package scipy, which the extra train has"
FIRST = "first click the object; with Shift, drag over what isn't the object"


class Isolate(Tool):
    """Singles out one thing."""

    word = "Isolate"
    name, title, icon = "isolate", "Isolate one thing", "object_ungroup"
    hint = "Click the object.  Drag: this.  Shift: not this.  Enter: cut the rest off.  Esc: back"

    _worker: ThreadPoolExecutor | None = None
    _coming: Future | None = None  # what strokes need, of the occupancy below
    _of = None  # [T] uint64
    _result: fields.Isolated | None = None
    _points = _places = None  # of the stroke in progress, at rest; middles now and at rest

    def __init__(self, controls):
        super().__init__(controls)
        self.strokes: list[fields.Stroke] = []

    # -- the mouse -----------------------------------------------------------------------

    def hover(self, pixel) -> None:
        """Begin to look at the model before the first stroke needs it."""
        self._begin()

    def press(self, pixel, modifiers) -> bool:
        point = self.view.surface_at(pixel, beside=False)
        if point is None:
            return False
        self._begin()
        self._places = self._middles_now(), self._middles_at_rest()
        self._this, self.mode = not modifiers & SHIFT, "isolate"
        away = float(np.linalg.norm(point - self.view.camera.position))
        unit = 1.0 if self.view.camera.parallel else away
        self._radius = BRUSH * self.view.ratio * unit / self.view.camera.focal
        self._points = [self._at_rest(point)]
        return True

    def move(self, before, pixel) -> bool:
        point = self.view.surface_at(pixel, beside=False)
        if point is not None:
            self._points.append(self._at_rest(point))
        return True

    def release(self, pixel, clicked, modifiers) -> None:
        stroke = fields.Stroke(np.array(self._points), self._this, self._radius)
        self.strokes.append(stroke)
        self._look()
        self.view.log("isolate", this=stroke.this, strokes=len(self.strokes))

    def cancel(self) -> None:
        self._points = None

    def end(self) -> None:
        self.mode, self._points, self._places = "", None, None

    def enter(self) -> bool:
        """Cut off what is left out; whether there was a preview."""
        if self._result is None or not self._is_in_hand:
            return False
        cuts, matter = self.scene.cuts, self._coming.result().matter
        goes = cuts.left & ~matter.masks(self._result.kept)
        self.view.say(said(cuts, lambda: cuts.delete(goes)))
        self.view.log("delete", left=int(cuts.kept.sum()))
        self.forget()
        self.scene.settings.tool = "grab"
        return True

    def forget(self) -> None:
        """Give up all strokes."""
        self.strokes, self._result = [], None

    # -- what they mean ------------------------------------------------------------------

    @property
    def marks(self):
        """Where sub-tets are marked now [n, 3], which are the object's [n] bool, and how large
        a mark is; None without a preview.
        """
        if not self._is_in_hand and self.strokes:
            self.forget()
        if self._result is None:
            return None
        isolation = self._coming.result()
        solid = np.flatnonzero(isolation.opacity > SOLID)
        solid = solid[:: 1 + len(solid) // MARKS_MAX]
        matter = isolation.matter
        mesh, positions = self.scene.field.mesh, self.scene.positions
        places = np.einsum(
            "nk,nkx->nx", matter.weights[solid], positions[mesh.tets[matter.tets[solid]]]
        )
        return places, self._result.kept[solid], 0.4 * matter.edge

    @property
    def _is_in_hand(self):
        return self.scene.settings.tool == self.name

    def _begin(self):
        """Let a thread look at what is left of the object, if that isn't known or has changed."""
        left = self.scene.cuts.left
        if self._coming is not None and np.array_equal(left, self._of):
            return
        self.forget()
        self._worker = self._worker or ThreadPoolExecutor(1, "isolate")
        field = replace(self.scene.field, occupancy=left)
        self._of, self._coming = left, self._worker.submit(fields.isolation_of, field)

    def _look(self):
        """Find out what the strokes single out, and say so."""
        if not any(stroke.this for stroke in self.strokes):
            self.strokes.clear()
            self.view.say(FIRST)
            return
        try:
            isolation = self._coming.result()
            self._result = fields.isolated(isolation, self.strokes)
        except ModuleNotFoundError as error:
            self.forget()
            self.view.say(NEEDS_SCIPY if error.name == "scipy" else str(error))
            return
        except ValueError as error:
            self.strokes.pop()
            self.view.say(str(error))
            return
        text = fields.left_out_in_words(isolation, self._result)
        self.view.say(f"Enter cuts off {text}")

    def _middles_now(self):
        """Middles of what is left, now.  [N, 3]"""
        mesh, left = self.scene.field.mesh, unpack_mask(self.scene.cuts.left)
        corners = self.scene.positions[mesh.tets]
        return np.einsum("sk,tkx->tsx", subtet_corners().mean(axis=1), corners)[left]

    def _middles_at_rest(self):
        """The same at rest.  [N, 3]"""
        return subtet_middles(self.scene.field.mesh)[unpack_mask(self.scene.cuts.left)]

    def _at_rest(self, point):
        """Where the matter nearest to a point is at rest.  [3]"""
        now, rest = self._places
        return rest[((now - point) ** 2).sum(axis=1).argmin()].astype(float)
