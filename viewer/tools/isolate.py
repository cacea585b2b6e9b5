"""The tool that singles out one thing: a click on it, strokes for "this" and "not this", a cut.

What strokes mean is core/field/isolation's, found out in a thread; their points are kept at rest,
so that a bent object can be worked on.  Before the first stroke, flat parts that go on beyond the
object are offered.  The preview marks sub-tets in two colors.  A cut is a deletion like any other:
sessions have it, and it can be undone.  Until then undo takes strokes back.

Shapes: T tets, N occupied sub-tets, n of them that are marked.
"""

import time
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from threading import Thread

import numpy as np

from ...core import field as fields
from ...core.field import subtet_middles, unpack_mask
from ...core.geometry import EmbeddedPoints
from .brushes import said
from .keys import SHIFT
from .tool import Tool

BRUSH = 4.0  # points: half the width of a stroke
OURS, OTHERS = (0.10, 0.55, 0.95), (0.95, 0.45, 0.10)  # blue and orange: told apart by all eyes
SOLID, MARKS_MAX = 0.3, 12_000  # opacity of sub-tets that are marked, and how many at most
NEEDS_SCIPY = "this needs the package scipy, which the extra train has"
FIRST = "first click the object; with Shift, drag over what isn't the object"
BESIDE = "nothing is there: click the object itself"
WAIT = "wait until it is worked out what goes"
SLOW = 0.4  # s, from which on it is told that something is worked out


class Isolate(Tool):
    """Singles out one thing.

    Attributes:
        strokes: Those that count, one after another; another tuple after each change.
    """

    hint = "Click the object.  Drag: this.  Shift: not this.  Enter: cut the rest off.  Esc: back"

    _work: Future | None = None  # in progress, and since when
    _since = 0.0
    _isolation: fields.Isolation | None = None  # of what the model had at a revision
    _isolation_of = None
    _asked = _answered = None  # revision and strokes: of the work, and of the result
    _result: fields.Isolated | None = None
    _points = _places = None  # of the stroke in progress, at rest; middles now and at rest

    def __init__(self, controls):
        super().__init__(controls)
        self.forget()

    # -- the mouse -----------------------------------------------------------------------

    def press(self, pixel, modifiers) -> bool:
        point = self.view.surface_at(pixel, beside=False)
        if point is None:
            return False
        mesh, left = self.scene.field.mesh, unpack_mask(self.scene.cuts.left)
        shapes = self.scene.positions, mesh.rest_vertices
        self._places = [subtet_middles(mesh, vertices)[left] for vertices in shapes]
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
        if not self._this and not self.strokes:
            self.view.say(FIRST)
            return
        stroke = fields.Stroke(np.array(self._points), self._this, self._radius)
        self.strokes, self._undone = (*self.strokes, stroke), ()
        self.view.log("isolate", this=stroke.this, strokes=len(self.strokes))

    def click(self, pixel) -> None:
        self.view.say(BESIDE)

    def cancel(self) -> None:
        self._points = None

    def end(self) -> None:
        self.mode, self._points, self._places = "", None, None

    # -- keys ----------------------------------------------------------------------------

    def enter(self) -> bool:
        """Cut off what is marked to go."""
        self._follow()
        if self.busy or self._result is None:
            self.view.say(WAIT if self.busy else FIRST)
            return True
        cuts, strokes = self.scene.cuts, self.strokes
        goes = cuts.left & ~self._isolation.matter.masks(self._result.kept)
        self.view.say(said(cuts, lambda: cuts.delete(goes)))
        self.view.log("delete", left=int(cuts.kept.sum()))
        self.forget()
        if strokes:  # else flat parts have gone, and the object is still to be clicked
            self.scene.settings.tool = "grab"
        return True

    @property
    def undoes(self) -> str:
        return "stroke" * bool(self.strokes)

    @property
    def redoes(self) -> str:
        return "stroke" * bool(self._undone)

    def undo(self) -> bool:
        *left, last = self.strokes
        self.strokes, self._undone = tuple(left), (*self._undone, last)
        return True

    def redo(self) -> bool:
        *self._undone, last = self._undone
        self.strokes = (*self.strokes, last)
        return True

    def forget(self) -> None:
        """Give up all strokes."""
        self.strokes, self._undone, self._result, self._answered = (), (), None, None

    # -- what they mean ------------------------------------------------------------------

    @property
    def busy(self) -> bool:
        """Whether something is worked out."""
        return self._work is not None

    @property
    def told(self) -> str:
        """What is to be done, and what the colors mean."""
        if self.scene.settings.tool != self.name:
            return ""
        if self.busy and time.monotonic() - self._since > SLOW:
            seconds = f"{time.monotonic() - self._since:.0f} s"
            known = self._isolation_of == self.scene.cuts.revision
            then = "" if known or self.strokes else ": you can click the object already"
            return f"{'working out' if known else 'looking at the model'}, {seconds}{then}"
        if self._result is None:
            return "Click the object"
        words = fields.left_out_in_words(self._isolation, self._result, where=False)
        if not self._answered[1]:
            return f"Orange goes: {words}.  Enter leaves it out.  Or click the object"
        return f"Blue stays, orange goes: {words}.  Enter cuts"

    @property
    def marks(self):
        """Where sub-tets are marked now [n, 3], in which color [n, 3], and how large a mark is;
        None without a preview.
        """
        self._follow()
        if self._result is None:
            return None
        isolation, kept = self._isolation, self._result.kept
        # Before the first stroke nobody knows what is the object's.
        known = bool(self._answered[1])
        solid = np.flatnonzero((isolation.opacity > SOLID) & (known | ~kept))
        solid = solid[:: 1 + len(solid) // MARKS_MAX]
        matter = isolation.matter
        corners = self.scene.field.mesh.tets[matter.tets[solid]]
        places = EmbeddedPoints(corners, matter.weights[solid]).points(self.scene.positions)
        return places, np.where(kept[solid, None], OURS, OTHERS), 0.4 * matter.edge

    def _follow(self):
        """Take what the thread has found out, and give it what is to be found out next."""
        revision, settings = self.scene.cuts.revision, self.scene.settings
        if settings.tool == self.name and self.busy and self._work.done():
            work, self._work = self._work, None
            self._take(work, *self._asked)
        if settings.tool != self.name:
            if self.strokes or self._undone or self._answered:
                self.forget()
            return
        if self._answered and self._answered[0] != revision:
            self.forget()
        if self.busy:
            return
        # The thread holds neither tool nor scene: another model may be shown before it ends.
        if self._isolation_of != revision:
            field = replace(self.scene.field, occupancy=self.scene.cuts.left)
            self._begin(partial(fields.isolation_of, field))
        elif self._answered is None or self._answered[1] is not self.strokes:
            self._begin(partial(singled_out, self._isolation, self.strokes))

    def _begin(self, work):
        self._asked, self._since = (self.scene.cuts.revision, self.strokes), time.monotonic()
        self._work = in_thread(work)

    def _take(self, work, revision, strokes):
        """Show what the thread has found, or say why it could not."""
        error = work.exception()
        if error is None:
            result = work.result()
            if isinstance(result, fields.Isolation):
                self._isolation, self._isolation_of = result, revision
                return
            if revision != self.scene.cuts.revision or strokes is not self.strokes:
                return  # something else is to be found out by now
            self._result = result if strokes or result.left_out else None
            self._answered = revision, strokes
            self.view.log("isolated", strokes=len(strokes), flats=len(result.left_out))
        elif isinstance(error, ValueError) and strokes:  # the last one names nothing
            self.strokes = tuple(one for one in self.strokes if one is not strokes[-1])
            self.view.say(str(error))
        else:
            self.view.say(NEEDS_SCIPY if getattr(error, "name", "") == "scipy" else str(error))
            self.scene.settings.tool = "grab"

    def _at_rest(self, point):
        """Where the matter nearest to a point is at rest.  [3]"""
        now, rest = self._places
        return rest[((now - point) ** 2).sum(axis=1).argmin()].astype(float)


def singled_out(isolation: fields.Isolation, strokes) -> fields.Isolated:
    """What strokes mean; without any, what is left without flat parts that go on beyond it."""
    return fields.isolated(isolation, strokes) if strokes else fields.without_flats(isolation)


def in_thread(work) -> Future:
    """What a function returns or raises, from a thread that no end of the program waits for."""
    future = Future()

    def run():
        try:
            future.set_result(work())
        except BaseException as error:
            future.set_exception(error)

    Thread(target=run, name="isolate", daemon=True).start()
    return future
