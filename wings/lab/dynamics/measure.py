"""Error of the solver against its run time, on a body that is held at its foot and pushed.

    static    it gives way until it is still;                  reference: Newton's method
    dynamic   it moves for 0.2 s from rest, undamped;          reference: Verlet
              (all 12 frames count: at one moment the phase of a stiff body's ringing decides)

The push is a sideways gravity g under which the body would, if it stayed linear, move by
PUSH of its size at most.  (Downwards a standing object buckles, and chance decides which way.)

    K u = M e_x,   g = PUSH size / max |u_i|,   K the energy's Hessian at rest

Error is the RMS over vertices (and frames) of |x − reference|, over the reference's RMS
motion and over the object's size.  An error of a tenth of the motion means that the solver
holds the body as if E were a tenth lower.

Shapes: V vertices, F frames.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from ....core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver, lowest_pins
from ....core.geometry import TetMesh
from ..stopwatch import Spread, milliseconds, spread_of
from .energy import Energy, material_energy
from .references import equilibrium, factorize, free_dofs, motion

SCENES = ("static", "dynamic")
PUSH = 0.05  # of the size
BOUND = 0.0025  # of the motion, in both scenes
SOFTEST = 1e-12  # of the stiffest pivot: what rounding leaves of no stiffness
ASIDE = np.array([1.0, 0.0, 0.0])
MOTION_FRAMES = 12  # 0.2 s
SETTLING_DAMPING = 10.0  # 1/s, near critical for the softest case
SETTLING_FRAMES = 1800  # at most
STILL = 1e-6  # of the size in half a second
WARM_UP, TIMED_FRAMES = 3, 30
DEFAULT_COUNT = XpbdOptions().substep_count
DEFAULT_MATERIAL = Material()


class HeldMesh(NamedTuple):
    """A mesh and what holds it."""

    rest: np.ndarray  # [V, 3] float64, rounded to float32 as the solver's
    tets: np.ndarray  # [T, 4]
    held: np.ndarray  # [V] bool


@dataclass(frozen=True)
class LoadCase:
    """A body, its material, and the gravity that moves it."""

    body: HeldMesh
    scene: str  # one of SCENES
    gravity: tuple[float, float, float]  # m/s²
    solid: Material = DEFAULT_MATERIAL  # its damping is replaced by that of the scene

    @property
    def material(self) -> Material:
        """The material, with the damping of the scene."""
        return replace(self.solid, damping=SETTLING_DAMPING if self.scene == "static" else 0.0)

    @property
    def energy(self) -> Energy:
        """The energy that the solver minimizes."""
        rest, tets, _ = self.body
        return material_energy(rest, tets, self.material)

    @cached_property
    def reference(self) -> tuple[np.ndarray, float]:
        """The exact positions of the vertices [F, V, 3], and their own error.

        Static: at rest, and the forces that are left over the loads.  Dynamic: frame by
        frame, and the RMS error over the motion.

        Raises:
            NoEquilibrium: Newton's method finds no rest.
        """
        rest, _, held = self.body
        if self.scene == "static":
            vertices, residual = equilibrium(self.energy, rest, held, self.gravity)
            return vertices[None], residual
        duration = MOTION_FRAMES * TIME_STEP
        path, error = motion(self.energy, rest, held, self.gravity, duration, MOTION_FRAMES)
        return path, error / _rms(path - rest)

    def solver(self, substep_count, device) -> XpbdSolver:
        """The program's solver, which never sleeps and never begins a rescue."""
        rest, tets, held = self.body
        options = XpbdOptions(
            substep_count=substep_count, gravity=self.gravity, sleep_motion=0.0, rescue=False
        )
        return XpbdSolver(rest, tets, self.material, held, options, device)


@dataclass(frozen=True)
class DynamicsRow:
    """The solver on one load case; `of_motion` is None where nothing moves."""

    scene: Annotated[str, "scene"]
    count: Annotated[int, "substeps"]
    of_motion: Annotated[float | None, "of the motion [%]"]
    of_size: Annotated[float, "of the size [%]"]
    largest: Annotated[float, "largest, of the size [%]"]
    frame: Annotated[Spread, "ms a frame"]
    frames: int
    default: bool
    chosen: Annotated[bool, "the rule's"]


def standing(mesh: TetMesh) -> HeldMesh:
    """A mesh that stands on its foot, as the solver's float32 has it."""
    rest = mesh.rest_vertices.astype(np.float32).astype(np.float64)
    return HeldMesh(rest, mesh.tets, lowest_pins(rest, mesh.tets))


def response(energy: Energy, rest, held, direction):
    """Displacements of a linear body per m/s² of gravity in a direction.  [V, 3] s²"""
    if held.all():
        raise RuntimeError("all of the body is held")
    dofs = free_dofs(held)
    factors = factorize(energy.hessian(rest)[dofs][:, dofs])
    pivots = np.zeros(1) if factors is None else factors.U.diagonal()
    if pivots.min() <= SOFTEST * pivots.max():
        raise RuntimeError("some of the body moves without resistance")
    moved = np.zeros(rest.size)
    moved[dofs] = factors.solve((energy.masses[:, None] * direction).ravel()[dofs])
    return moved.reshape(-1, 3)


def load_cases(body: HeldMesh) -> list[LoadCase]:
    """The static and the dynamic scene of a body, pushed sideways.

    Raises:
        RuntimeError: Some of the body can move without resistance.
    """
    rest, tets, held = body
    energy = material_energy(rest, tets, DEFAULT_MATERIAL)
    most = np.linalg.norm(response(energy, rest, held, ASIDE), axis=1).max()
    strength = PUSH * float(np.ptp(rest, axis=0).max()) / float(most)
    gravity = tuple((strength * ASIDE).tolist())
    return [LoadCase(body, scene, gravity) for scene in SCENES]


def measure(case: LoadCase, substep_count, device, settling_frames=SETTLING_FRAMES) -> DynamicsRow:
    """The solver's error on a load case, and its time a frame.

    Args:
        settling_frames: At most, until a static case is still.

    Raises:
        NoEquilibrium: There is no reference.
    """
    rest, (reference, _) = case.body.rest, case.reference
    solver = case.solver(substep_count, device)
    size = float(np.ptp(rest, axis=0).max())
    times = []

    def step(count):
        times.extend(milliseconds(lambda: solver.step(TIME_STEP), device) for _ in range(count))
        return solver.vertices.numpy().astype(np.float64)

    if case.scene == "dynamic":
        path = [step(1) for _ in range(MOTION_FRAMES)]
    else:
        before, now = rest + size, rest
        while len(times) < settling_frames and np.abs(now - before).max() >= STILL * size:
            before, now = now, step(30)
        path = [now]
    frames = len(times)
    if frames < WARM_UP + TIMED_FRAMES:  # the motion alone is too short for a median
        step(WARM_UP + TIMED_FRAMES - frames)
    away = np.array(path) - reference
    error, moved = _rms(away), _rms(reference - rest)
    return DynamicsRow(
        scene=case.scene,
        count=substep_count,
        of_motion=100.0 * error / moved if moved > 0.0 else None,
        of_size=100.0 * error / size,
        largest=100.0 * float(np.linalg.norm(away, axis=-1).max()) / size,
        frame=spread_of(times[WARM_UP:]),
        frames=frames,
        default=substep_count == DEFAULT_COUNT,
        chosen=False,
    )


def _rms(vectors):
    """The root of the mean square length.  [..., 3]"""
    return float(np.sqrt((vectors**2).sum(axis=-1).mean()))
