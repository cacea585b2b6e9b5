"""Edits: what a user's hand does to a scene, recorded at ticks, and undone.

A tick is a 60th of a second of the object's time.  An edit is a method that `@edit` marks: of
Scene, or of a class like Body whose object the scene has under the class's name (`scene.body`)
and which extends Edited.  Who calls it needs to know nothing of the journal, which
notes the tick, the name and the arguments.  The same edits at the same ticks give the same
vertices, on one device to the bit (session.py stores and plays them).

Before an edit that changes more than a view, the journal keeps the scene's state, so that it
can be undone.  `unsaved` says whether steps were made, or undone, since `mark_saved`.
"""

import inspect
import math
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, NamedTuple

import numpy as np

from ....core.base.streams import shown

# What the panel calls an attribute, where that differs; several at once are a preset.
WORDS = {
    "young_modulus": "stiffness",
    "poisson_ratio": "Poisson ratio",
    "yield_strain": "yielding",
    "substep_count": "substeps",
}
FEWEST_STEPS, MOST_BYTES = 100, 256 * 2**20  # so many steps are kept, and more up to that size
MAY_BE_INFINITE = ("yield_strain",)  # the only values of an edit that are no finite numbers
MERGED_TICKS = 30  # a slider's changes that follow each other so soon are one step

EDITS = {}  # name: Edit


class Edit(NamedTuple):
    """A method that a session may call."""

    method: str
    owner: str  # the scene's attribute that has it; empty: the Scene itself
    parameters: tuple[str, ...]
    any_names: bool  # whether it takes attributes by any name


class Event(NamedTuple):
    """One edit that was made."""

    tick: int  # so many ticks had passed
    name: str
    arguments: dict[str, Any]  # of numbers, strings, lists, bools and None


@dataclass
class Step:
    """What undo takes back at once."""

    label: str
    tick: int  # of its last edit
    before: object  # the scene's state
    merges: bool = False  # with an edit of the same label that follows soon
    after: object = None  # the state that redo returns to, once it is undone
    in_vain: bool = False  # it came to nothing


def edit(name: str, undo: str = "", merges: bool = False, begins: bool = False):
    """Mark a method as an edit.

    Args:
        undo: What the user calls it, if it begins a step that can be undone; with its arguments
            in braces.
        begins: Whether the step's changes come later, as in a drag.  Otherwise one that changes
            nothing is no step.
        merges: Whether it joins the step before if that is the same and was made just now.

    An argument that is not finite, or has a number that isn't, is a ValueError of the method.
    """

    def decorate(method):
        signature = inspect.signature(method)
        own = list(signature.parameters.values())[1:]
        any_names = any(p.kind is p.VAR_KEYWORD for p in own)
        names = tuple(p.name for p in own if p.kind is not p.VAR_KEYWORD)
        of_class = method.__qualname__.split(".")[0].lower()
        owner = "" if of_class == "scene" else of_class
        EDITS[name] = Edit(method.__name__, owner, names, any_names)

        @wraps(method)
        def recorded(self, *arguments, **named):
            journal = self.journal
            if journal is None or journal.inside:
                return method(self, *arguments, **named)
            bound = signature.bind(self, *arguments, **named)
            values = dict(zip(names, bound.args[1:], strict=True)) | bound.kwargs
            values = {key: _plain(value) for key, value in values.items()}
            for key, value in values.items():
                if not (_is_finite(value) or (key in MAY_BE_INFINITE and value == math.inf)):
                    raise ValueError(f"{name} can't have {key} = {shown(value)}")
            changed = ", ".join(WORDS.get(one, one) for one in values)
            changed = changed if len(values) <= 2 else "material"
            label = undo.format(**({"names": changed} | values))
            with journal.editing(name, values, label, merges, begins):
                return method(self, *arguments, **named)

        return recorded

    return decorate


def _plain(value):
    """A value as JSON has it; floats keep all their digits."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, dict):
        return {name: _plain(one) for name, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _is_finite(value):
    """Whether all numbers in a value as JSON has it are finite."""
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, dict):
        return all(map(_is_finite, value.values()))
    return not isinstance(value, list) or all(map(_is_finite, value))


class Edited:
    """A part of a scene that has edits.

    Attributes:
        journal: The scene's, once it has one.
        kept: Names of the attributes that edits change; what they hold is never changed in place.
    """

    journal = None
    kept: tuple[str, ...] = ()

    def state(self) -> dict:
        """What undo brings back."""
        return {name: getattr(self, name) for name in self.kept}

    def restore(self, state: dict) -> None:
        """Return to a state."""
        for name in self.kept:
            setattr(self, name, state[name])


class Journal:
    """The edits of one scene, and what can be undone."""

    def __init__(self, states):
        """Take the scene's States."""
        self.inside = False  # an edit: what it calls belongs to it
        self._states = states
        self.clear()

    def clear(self) -> None:
        """Forget all edits, and what could be undone."""
        self.tick = 0  # that have passed
        self.events: list[Event] = []
        self.steps: list[Step] = []
        self.cursor = 0  # steps before it can be undone, the others done again
        self._view = {}  # that was noted last
        self.noted = None, None  # the camera and what else was shown then
        self._oldest: Step | None = None  # the last one that was forgotten, before all steps
        self._saved: object = None  # the step whose result is saved; None: the state before all

    @contextmanager
    def editing(self, name, arguments, label, merges, begins):
        """Record an edit, unless it raises, and what it calls not at all."""
        before = self._states.now() if label and not self._merge(label, merges) else None
        with self.unrecorded():
            yield
        if before is not None and (begins or not self._states.is_still(before)):
            del self.steps[self.cursor :]
            self.steps.append(Step(label, self.tick, before, merges))
            while len(self.steps) > FEWEST_STEPS and self._size() > MOST_BYTES:
                self._oldest = replace(self.steps.pop(0), before=None)
            self.cursor = len(self.steps)
        self.events.append(Event(self.tick, name, arguments))

    @contextmanager
    def unrecorded(self):
        """For what follows from time and earlier edits: its edits are not recorded."""
        self.inside, before = True, self.inside
        try:
            yield
        finally:
            self.inside = before

    def note(self, name: str, **arguments) -> None:
        """Record what is no edit: a view, for the film."""
        values = {key: _plain(value) for key, value in arguments.items()}
        self.events.append(Event(self.tick, name, values))

    def note_view(self, view: dict) -> None:
        """Record what has changed of the camera, of the way to show the object, or of both."""
        view = {name: _plain(value) for name, value in view.items()}
        if not all(map(math.isfinite, (*view.get("target", ()), view.get("distance", 0.0)))):
            return  # a camera that looks at vertices that aren't numbers
        changed = {name: value for name, value in view.items() if value != self._view.get(name)}
        if changed:
            self.note("view", **changed)
            self._view = self._view | view

    def forget_view(self, names) -> None:
        """Something else has changed these values of the view: they are recorded next time."""
        self._view = {name: one for name, one in self._view.items() if name not in names}
        self.noted = None, None

    # -- what is saved -------------------------------------------------------------------

    @property
    def unsaved(self) -> bool:
        """Whether steps were made, or undone, since `mark_saved` or the beginning."""
        return self._last_step() is not self._saved

    def mark_saved(self, saved: bool = True) -> None:
        """All that was done is in a file from now on; or, if not `saved`, in none."""
        self._saved = self._last_step() if saved else object()
        if self.cursor:
            self.steps[self.cursor - 1].merges = False  # what follows is unsaved

    def _last_step(self):
        """The step that led to the present state, but for those that came to nothing."""
        made = (step for step in reversed(self.steps[: self.cursor]) if not step.in_vain)
        return next(made, self._oldest)

    # -- undo ----------------------------------------------------------------------------

    def forget_step(self, label: str) -> None:
        """The last step with this label came to nothing; what was done during it stays.

        A first step without others behind it stays as well: it alone has the state in which all
        began, to the bit.
        """
        labels = [step.label for step in self.steps]
        if self.cursor != len(labels) or label not in labels:
            return
        if len(labels) == 1:
            self.steps[0].in_vain = True
            return
        at = len(labels) - 1 - labels[::-1].index(label)
        gone, *during = self.steps[at:]
        if during:  # the first of them began as the one that is gone, the others where it was
            where = {name: gone.before[name] for name in ("vertices", "velocities")}
            for step in during[1:]:
                step.before = step.before | where
            during[0].before = gone.before
        del self.steps[at]
        self.cursor -= 1

    def _size(self):
        """About how much memory the steps take [bytes]: all states are as large as the last."""
        return len(self.steps) * sum(np.size(x) * 8 for x in self.steps[-1].before.values())

    def _merge(self, label, merges):
        """Whether an edit belongs to the step before."""
        last = self.steps[self.cursor - 1] if self.cursor else None
        if not (merges and last and last.merges and last.label == label):
            return False
        soon = self.tick - last.tick <= MERGED_TICKS
        if soon:
            last.tick = self.tick
            del self.steps[self.cursor :]
        return soon

    @property
    def undoes(self) -> str:
        """What undo would take back; empty if nothing."""
        return self.steps[self.cursor - 1].label if self.cursor else ""

    @property
    def redoes(self) -> str:
        """What redo would do again; empty if nothing."""
        return self.steps[self.cursor].label if self.cursor < len(self.steps) else ""

    def undo(self) -> bool:
        """Return to the state before the last step; whether there was one."""
        if not self.cursor:
            return False
        self.cursor -= 1
        step = self.steps[self.cursor]
        step.after = self._states.now()
        self._states.restore(step.before)
        return True

    def redo(self) -> bool:
        """Return to the state from which the step after was undone; whether there was one."""
        if self.cursor == len(self.steps):
            return False
        step = self.steps[self.cursor]
        self.cursor += 1
        step.merges = False  # any more
        self._states.restore(step.after)
        return True
