"""What was deleted of the object: sub-tets, tets without any left, and what follows from that.

Nothing is renumbered: vertices, tets and handles keep their ids, so sessions, undo, poses and
keys of the timeline stay valid.  What is left is a mask of sub-tets for the renderer, and a list
of tets for the solver.  A smaller model is made of them when it is saved.

A stroke of the brush is a preview, which only the renderer sees; `keep_preview` makes one edit
of it.  Shapes: V vertices, T tets, C control points.
"""

from dataclasses import replace
from typing import Protocol

import numpy as np

from ....core import field as fields
from ....core.base.kept import Kept
from ....core.field import SUBTET_COUNT, pack_mask, subtet_corners, subtet_middles, unpack_mask
from ....core.geometry import tet_neighbours
from ..history.journal import Edited, edit
from ..rigging.hold import Solved
from .body import Body
from .points import ControlPoints

ALL = np.uint64(2**SUBTET_COUNT - 1)
DIGITS = SUBTET_COUNT // 4  # hexadecimal, of a mask in a session
LOWEST_PART = 0.05  # of the object's height, that is pinned
APART = 1.5  # edges of a sub-tet from a control point to matter: farther, the point has gone


class PlacedHandles(Protocol):
    """Handles, of which some may be deleted."""

    points: ControlPoints

    def forget_deleted(self) -> None: ...


class Cuttable(Solved, Protocol):
    """The object of which parts can be deleted."""

    field: fields.TetField  # the whole
    floor: float
    pins: np.ndarray  # of a held object  [V] bool
    held: bool
    body: Body
    handles: PlacedHandles

    def let_loose(self) -> None: ...


class Cuts(Edited):
    """What is deleted of one object.

    Attributes:
        removed: Sub-tets that are deleted; never changed in place.  [T] uint64
        kept: Tets that the solver works on: with matter, or empty and near it.  [T] bool
        vertices: Which vertices belong to one of them.  [V] bool
        revision: Counts the changes of what is left, previews too.
    """

    def __init__(self, whole: Cuttable):
        self._whole = whole
        self.removed = np.zeros(whole.field.mesh.tet_count, np.uint64)
        self.kept = np.ones(len(self.removed), bool)
        self.vertices = np.ones(whole.field.mesh.vertex_count, bool)
        self.revision = 0
        self._preview = None  # masks [T] uint64
        self._points_left = Kept()

    # -- what is left --------------------------------------------------------------------

    @property
    def some(self) -> bool:
        """Whether anything was deleted, or is about to be."""
        return self._preview is not None or bool(self.removed.any())

    @property
    def left(self):
        """Sub-tets that may hold density.  [T] uint64"""
        gone = self.removed if self._preview is None else self.removed | self._preview
        return self._whole.field.occupancy & ~gone

    @property
    def tets(self):
        """Vertices of the tets that are kept.  [T', 4]"""
        return self._whole.field.mesh.tets[self.kept]

    @property
    def neighbours(self):
        """The tet across each face of those that are kept, among them.  [T', 4]"""
        field = self._whole.field
        return field.neighbours if self.kept.all() else tet_neighbours(self.tets)

    @property
    def field(self) -> fields.TetField:
        """The whole field with all its tets, without density where it was deleted."""
        return replace(self._whole.field, occupancy=self.left)

    def smaller(self, stiffness, rig_arrays=None) -> fields.TetField:
        """The field of what is left, with these factors of stiffness [V] or None, and this rig."""
        field = replace(self.field, stiffness=stiffness, rig_arrays=rig_arrays)
        return field if self.kept.all() else fields.reduced(field, self.kept)

    @property
    def lowest(self) -> float:
        """The height of the lowest matter that is left, at rest; the object's floor if all is."""
        if not self.removed.any():
            return self._whole.floor
        return max(float(self._matter_middles()[:, 2].min()), self._whole.floor)

    def points_left(self):
        """Which control points are at matter that is left.  [C] bool"""
        points = self._whole.handles.points
        if not self.removed.any():
            return np.ones(len(points), bool)
        return self._points_left.of((self.removed, points), lambda: self._near_matter(points))

    def _near_matter(self, points):
        """Whether matter that is left is about as near as it was, to each point at rest.  [C]"""
        field = self._whole.field
        mesh, corners = field.mesh, subtet_corners().mean(axis=1)
        near = np.zeros(len(points), bool)
        for number, place in enumerate(points.at(mesh.rest_vertices)):
            beside = np.isin(mesh.tets, points.corners[number]).any(axis=1)
            own = mesh.rest_vertices[mesh.tets[beside]].astype(float)
            edge = np.linalg.norm(own[:, 1:] - own[:, :1], axis=2).mean() / 4.0
            away = np.linalg.norm(np.einsum("sk,tkx->tsx", corners, own) - place, axis=2)
            left, all_of_it = (unpack_mask(m[beside]) for m in (self.left, field.occupancy))
            before = away[all_of_it].min(initial=np.inf)
            near[number] = away[left].min(initial=np.inf) <= max(before, APART * edge)
        return near

    def _matter_middles(self):
        """Middles of all sub-tets that are left, at rest.  [N, 3]"""
        return subtet_middles(self._whole.field.mesh)[unpack_mask(self.left)]

    # -- deleting ------------------------------------------------------------------------

    def show_preview(self, masks) -> None:
        """Let these sub-tets vanish from the picture for now; None: let them come back."""
        self._preview = masks
        self.revision += 1

    def keep_preview(self) -> bool:
        """Delete what the preview has; whether that was anything."""
        masks, self._preview = self._preview, None
        return masks is not None and self.delete(masks)

    def delete(self, masks) -> bool:
        """Delete these sub-tets [T] uint64; whether any of them was left.

        Raises:
            ValueError: Nothing would be left.
        """
        masks = masks & self.left
        ids = np.flatnonzero(masks)
        self.revision += 1  # a preview has gone, at least
        if not len(ids):
            return False
        self._delete(ids, [f"{mask:0{DIGITS}x}" for mask in masks[ids].tolist()])
        return True

    def delete_specks(self) -> int:
        """Delete small parts that are apart from the others; returns how many tets they had."""
        chosen = fields.specks(self.field)
        self.delete(np.where(chosen, ALL, np.uint64(0)))
        return int(chosen.sum())

    @edit("delete", undo="delete")
    def _delete(self, tets, masks):
        if len(tets) != len(masks):
            raise ValueError(f"{len(tets)} tets have {len(masks)} masks")
        if len(tets) and max(tets) >= len(self.removed):
            raise ValueError(f"there is no tet {max(tets)}")
        removed = self.removed.copy()
        removed[np.asarray(tets, int)] |= np.array([int(mask, 16) for mask in masks], np.uint64)
        if not (self._whole.field.occupancy & ~removed).any():
            raise ValueError("nothing of the object would be left: undo, or delete less")
        whole = self._whole
        whole.let_loose()  # keys hold vertices of the solver before, and would set other pins
        was_held = whole.held
        self._take(removed)
        if not (whole.pins & self.vertices).any():
            whole.pins = self._lowest_part()
        if was_held and not whole.held:
            whole.solver.set_pinned(whole.solver.pinned | whole.pins)
        whole.handles.forget_deleted()

    def _lowest_part(self):
        """The lowest vertices of what is left.  [V] bool"""
        heights = self._matter_middles()[:, 2]
        low, high = float(heights.min()), float(heights.max())
        rest = self._whole.field.mesh.rest_vertices[:, 2]
        limit = max(low + LOWEST_PART * (high - low), float(rest[self.vertices].min()))
        return self.vertices & (rest <= limit)

    def _take(self, removed):
        """Let this be deleted: the solver follows if other tets are kept."""
        field = self._whole.field
        self.removed, self._preview = removed, None
        had, has = field.occupancy != 0, (field.occupancy & ~removed) != 0
        kept = fields.nearer_to_matter(field.neighbours, has, had & ~has)
        if not np.array_equal(kept, self.kept):
            self.kept = kept
            self.vertices = np.zeros(field.mesh.vertex_count, bool)
            self.vertices[self.tets] = True
            self._whole.body.set_tets(self.tets)
        self.revision += 1

    # -- undo ----------------------------------------------------------------------------

    def state(self) -> dict:
        return {"removed": self.removed, "pins": self._whole.pins}

    def restore(self, state: dict) -> None:
        """The solver's positions and pins are restored by others."""
        self._whole.pins = state["pins"]
        if self.removed is not state["removed"] or self._preview is not None:
            self._take(state["removed"])


def masks_of(tets, subtets, tet_count: int):
    """Masks of sub-tets given by their tets [N] and their numbers in these [N].  [T] uint64"""
    chosen = np.zeros((tet_count, SUBTET_COUNT), bool)
    chosen[tets, subtets] = True
    return pack_mask(chosen)
