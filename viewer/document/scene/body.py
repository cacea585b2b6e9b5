"""The body that the solver moves, in real units: its size, material and surroundings.

One unit of model space is S meters long.  The solver, which takes a unit for a meter, moves as
the real object does if it gets E/S², gravity/S and wind/S, and the same density; only its speed
limit stays in object sizes.
"""

import warnings
from dataclasses import replace

import numpy as np

from ....core.base.arguments import LARGEST_SIZE, SMALLEST_SIZE
from ....core.base.kept import Kept
from ....core.base.schema import number
from ....core.deform import Material, XpbdOptions, XpbdSolver
from ....core.field import STIFFNESS_RANGE
from ....core.geometry import signed_volumes
from ..history.journal import Edited, edit

EARTH = 9.81  # m/s²
FLOATING_DRAG = 1.0  # 1/s, without gravity: there a thrown object would never stop


class Body(Edited):
    """A solver, and the real values of what it is given.

    Attributes:
        material: The real one; change it by set_material.
        meters_per_unit: Of model space.
        automatic_substeps: Whether their number follows the material, as `adapt_substeps` says.
        gravity: Downwards [m/s²]; 0 without gravity.
        wind: The air's speed along x [m/s].
        factors: Of Young's modulus at the vertices, or None: 1 everywhere; never changed in
            place.  [V]
    """

    kept = (
        *("material", "gravity", "wind", "_air_drag", "meters_per_unit", "factors"),
        *("automatic_substeps", "_rest_shapes"),
    )

    def __init__(self, rest_vertices, tets, pinned, size, meters, device, factors=None):
        """Take a mesh at rest of which what is visible has the longest side `size` [units].

        Args:
            meters: The length of that side; None: a unit is a meter.
            factors: Of Young's modulus at the vertices; None: 1.  [V]
        """
        self._size = size
        self.meters_per_unit = 1.0 if meters is None else meters / size  # S
        self.material = Material()
        self.gravity, self.wind, self._air_drag = 0.0, 0.0, None
        options = XpbdOptions(**self._surroundings())
        self.solver = XpbdSolver(rest_vertices, tets, self._scaled(), pinned, options, device)
        self._whole = self.solver.edges  # before anything is cut off
        self.factors = factors
        if factors is not None:
            self.solver.set_stiffness(factors)
        self._answers = Kept()  # the solver's, by the questions' names
        self._rest_shapes = ()  # those before the present one
        self.automatic_substeps = True
        self.adapt_substeps()
        self.solver.reset()  # it sleeps

    @property
    def meters(self) -> float:
        """The longest side of what can be seen."""
        return self.meters_per_unit * self._size

    def set_meters(self, meters: float) -> None:
        """Take the object for that large."""
        self.set_scale(max(meters, SMALLEST_SIZE) / self._size)

    @edit("set_scale", undo="size", merges=True)
    def set_scale(self, meters_per_unit: float) -> None:
        """Take a unit of model space for so many meters."""
        self.meters_per_unit = meters_per_unit
        self.set_material()
        self.set_options(**self._surroundings())

    # -- material ------------------------------------------------------------------------

    @edit("set_material", undo="{names}", merges=True)
    def set_material(self, **changes) -> None:
        with warnings.catch_warnings(action="ignore"):  # the panel says what is held
            self.material = replace(self.material, **changes)
            self.solver.set_material(self._scaled())

    def _scaled(self):
        modulus = self.material.young_modulus / self.meters_per_unit**2
        return replace(self.material, young_modulus=modulus)

    @property
    def held_young_modulus(self) -> float:
        """What these substeps hold of the material's [Pa]."""
        return self._told("held_young_modulus") * self.meters_per_unit**2

    @property
    def substeps_that_hold(self) -> int:
        """How many substeps hold the material's."""
        return self._told("substeps_that_hold")

    def _told(self, name):
        """What the solver's method of that name returns; it is asked once."""
        solver = self.solver  # none of what its answers follow from is changed in place
        follow_from = solver, solver.options, solver.material, solver.pinned, self.factors
        answers = self._answers.of(follow_from, dict)
        if name not in answers:
            answers[name] = getattr(solver, name)()
        return answers[name]

    @edit("set_options", undo="{names}", merges=True)
    def set_options(self, **changes) -> None:
        """Change some of the solver's XpbdOptions; a number of substeps stays from then on."""
        if "substep_count" in changes:
            self.automatic_substeps = False
        self.solver.set_options(replace(self.solver.options, **changes))

    @edit("set_automatic_substeps", undo="substeps")
    def set_automatic_substeps(self, on: bool) -> None:
        self.automatic_substeps = on

    def adapt_substeps(self) -> None:
        """Before time passes: take as many substeps as hold the material, if that is automatic."""
        count = self.substeps_that_hold if self.automatic_substeps else None
        if count not in (None, self.solver.options.substep_count):
            self._adapt_substeps(count)

    @edit("adapt_substeps")
    def _adapt_substeps(self, substep_count):
        """No step of its own, and recorded: later versions may take another number."""
        self.solver.set_options(replace(self.solver.options, substep_count=substep_count))

    def paint(self, ids, shares, factor):
        """Multiply the stiffness of these vertices [K], by `factor` where the share is 1.  [K]"""
        before = np.ones(len(self.solver.rest_vertices)) if self.factors is None else self.factors
        factors = before.copy()
        factors[ids] = np.clip(before[ids] * factor**shares, *STIFFNESS_RANGE)
        self.factors = factors
        self.solver.set_stiffness(factors)

    @edit("clear_paint", undo="equally stiff")
    def clear_paint(self):
        """Make the object equally stiff everywhere."""
        self.factors = None
        self.solver.set_stiffness(None)

    # -- the tets that it is made of -----------------------------------------------------

    def set_tets(self, tets) -> None:
        """Be made of these tets [T, 4] alone: a new solver, in the same pose, with all values.

        Vertices of no tet stay where they are.  What is held is let go.  Edges keep their
        stiffness: thin parts are not fitted again.
        """
        old = self.solver
        arguments = self._scaled(), old.pinned, old.options, str(old.device)
        with warnings.catch_warnings(action="ignore"):
            new = XpbdSolver(old.rest_vertices, tets, *arguments)
            new.set_stiffness(self.factors)
        if not np.array_equal(new.rest_shape, old.rest_shape):
            new.set_rest_shape(old.rest_shape)
        _take_lengths(new, old)
        vertices = old.vertices.numpy()
        at_rest = old.settled and np.array_equal(vertices, new.vertices.numpy())
        new.set_state(vertices.copy(), old.velocities.numpy().copy())
        if at_rest:
            new.fall_asleep()
        self.solver = new
        whole = self._whole.sheet_ratios, self._whole.vertices
        new.edges.sheet_ratios.follow(new.edges.vertices, *whole)

    # -- rest shape ----------------------------------------------------------------------

    @edit("rest_here", undo="rest here")
    def rest_here(self) -> bool:
        """Make the pose the shape to which the object returns, unless it is tangled."""
        positions = self.solver.vertices.numpy().astype(float)
        if not (signed_volumes(positions, self.solver.volumes.vertices) > 0.0).all():
            return False
        self._rest_shapes = *self._rest_shapes, self.solver.rest_shape
        self.solver.set_rest_shape(positions)
        return True

    @property
    def rests_elsewhere(self) -> bool:
        """Whether `rest_here` can be undone."""
        return bool(self._rest_shapes)

    @edit("undo_rest_here", undo="rest as before")
    def undo_rest_here(self) -> None:
        """Return to the shape from before the last `rest_here`, if there was one."""
        if self._rest_shapes:
            *self._rest_shapes, shape = self._rest_shapes
            self.solver.set_rest_shape(shape)

    # -- what surrounds it ---------------------------------------------------------------

    def set_gravity(self, strength: float) -> None:
        self.gravity = strength
        self.set_options(**self._surroundings())

    @property
    def air_drag(self) -> float:
        """The rate at which the air brakes [1/s]; by default only what floats without gravity."""
        if self._air_drag is None:
            return 0.0 if self.gravity else FLOATING_DRAG
        return self._air_drag

    @edit("set_air_drag", undo="air drag", merges=True)
    def set_air_drag(self, rate: float) -> None:
        self._air_drag = max(rate, 0.0)
        self.set_options(**self._surroundings())

    @edit("set_wind", undo="wind", merges=True)
    def set_wind(self, speed: float) -> None:
        """Let the air move; without air drag it moves nothing."""
        self.wind = speed
        self.set_options(**self._surroundings())

    # -- undo ----------------------------------------------------------------------------

    def state(self) -> dict:
        solver = self.solver
        return super().state() | {"options": solver.options, "rest_shape": solver.rest_shape}

    def restore(self, state: dict) -> None:
        super().restore(state)
        solver = self.solver
        if not np.array_equal(solver.rest_shape, state["rest_shape"]):
            solver.set_rest_shape(state["rest_shape"])
        solver.set_options(replace(state["options"], colliders=()))  # the ball is gone by now
        with warnings.catch_warnings(action="ignore"):
            solver.set_stiffness(self.factors)
            solver.set_material(self._scaled())

    def _surroundings(self):
        return {
            "gravity": (0.0, 0.0, -self.gravity / self.meters_per_unit),
            "wind": (self.wind / self.meters_per_unit, 0.0, 0.0),
            "air_drag": self.air_drag,
        }


def _take_lengths(new, old):
    """Give a solver's edges the rest lengths that another's have: they may have yielded."""
    lengths = new.rest_lengths
    ends, old_ends = (np.sort(solver.edges.vertices, axis=1) for solver in (new, old))
    count = len(new.rest_vertices)
    numbers, old_numbers = (pairs @ np.array([count, 1], np.int64) for pairs in (ends, old_ends))
    order = np.argsort(old_numbers, kind="stable")
    at = np.minimum(np.searchsorted(old_numbers[order], numbers), len(order) - 1)
    same = old_numbers[order[at]] == numbers
    taken = np.where(same, old.rest_lengths[order[at]], lengths)
    if not np.array_equal(taken, lengths):
        new.set_rest_lengths(taken)


def stored_size(meta: dict) -> float | None:
    """The longest side [m] that a model states; None if it states none that can be one."""
    size = meta.get("size")
    return float(size) if number(SMALLEST_SIZE, LARGEST_SIZE)(size) else None
