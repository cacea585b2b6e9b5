"""Error of the solver against the time that it takes, on a beam that is clamped at one end.

    static    it hangs under gravity until it is still;    reference: Newton (statics.py)
    dynamic   it falls for 0.2 s from rest, undamped;      reference: Verlet (dynamics.py)
              (over all 12 frames: at one moment the phase of a stiff beam's ringing decides)

Four schemes: n substeps of one iteration (the solver); one substep of n iterations with
stored multipliers (iterations.py); those without the floor under the compliance, which is in
units of h²: at one substep a frame it is what decides; and n substeps in which positions are
kept as plain float32 (plain.py).

Compliance is the same at every edge, without volume constraints, or None: the default
material with its volumes.  At compliance 0 the reference is the rest pose: a clamped body
that is infinitely stiff doesn't move, so what is left there is the artificial compliance of
one iteration and of the floor.

Error is the RMS over vertices (and frames) of |x − reference|, over the object's size; the
largest and the RMS over the reference's RMS displacement are given beside it.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...deform import COMPLIANCE_FLOOR, TIME_STEP, Material, XpbdOptions, XpbdSolver
from ...geometry import A15, BCC, KUHN
from ..stopwatch import Timing, milliseconds, timing_of
from .bodies import Beam, Held, beam
from .energy import Energy, material_energy, uniform_energy
from .iterations import IterationSolver
from .plain import PlainSolver
from .statics import equilibrium
from .verlet import motion

LATTICES = {"a15": A15, "bcc": BCC, "kuhn": KUHN}
# And how they are drawn.
SCHEMES = {"substeps": "-o", "iterations": "--s", "unfloored": ":^", "plain float32": "-.x"}
OF_SUBSTEPS = ("substeps", "plain float32")
SCENES = ("static", "dynamic")
COUNTS = (1, 2, 5, 10, 20, 50, 100, 200)
COMPLIANCES = (0.0, 1e-8, 1e-6, 1e-4, None)
GRAVITY = (0.0, 0.0, -9.81)
DEFAULT_MATERIAL = Material()
FALL_FRAMES = 12  # 0.2 s
SETTLING_DAMPING = 10.0  # 1/s, near critical for the softest case
SETTLING_FRAMES = 1800  # at most
STILL = 1e-6  # of the size in half a second
WARM_UP, TIMED_FRAMES = 3, 30


@dataclass(frozen=True)
class Case:
    """Attributes:
    lattice: A key of LATTICES, or whatever else the body is to be called.
    body: Its rest vertices are rounded to float32, as the solver's are.
    compliance: Of every edge [m/N]; None for the material.
    scene: "static" or "dynamic".
    gravity: [m/s²]
    solid: What it is made of, but for its damping.
    """

    lattice: str
    body: Beam | Held
    compliance: float | None
    scene: str
    gravity: tuple[float, float, float] = GRAVITY
    solid: Material = DEFAULT_MATERIAL

    @property
    def material(self) -> Material:
        return replace(self.solid, damping=SETTLING_DAMPING if self.scene == "static" else 0.0)

    @property
    def reference(self):
        """Where the vertices would be without error, frame by frame, or at last.  [F, V, 3]"""
        return self._solved[0]

    @property
    def reference_error(self) -> float:
        """How wrong the reference is itself, over its motion.

        Static: the forces that are left, over the loads.  Dynamic: a third of the difference
        to the run with twice the step, as the order is 2.
        """
        return self._solved[1]

    @cached_property
    def _solved(self):
        rest, held = self.body.mesh.rest_vertices, self.body.clamped
        if self.compliance == 0.0:
            return rest[None], 0.0
        if self.scene == "static":
            found = equilibrium(self.energy, rest, held, self.gravity)
            return found.vertices[None], found.residual
        duration = FALL_FRAMES * TIME_STEP
        moved = motion(self.energy, rest, held, duration, self.gravity, samples=FALL_FRAMES)
        way = np.sqrt(((moved.path - rest) ** 2).sum(axis=2).mean())
        return moved.path, moved.self_difference / 3.0 / float(way)

    @property
    def energy(self) -> Energy:
        rest, tets = self.body.mesh.rest_vertices, self.body.mesh.tets
        if self.compliance is None:
            return material_energy(rest, tets, self.material)
        return uniform_energy(rest, tets, self.material.density, self.compliance)

    def solver(self, scheme, count, device):
        """Ready to step; scheme is a key of SCHEMES, "unfloored" being iterations."""
        mesh, options = (
            self.body.mesh,
            XpbdOptions(
                substep_count=count if scheme in OF_SUBSTEPS else 1,
                gravity=self.gravity,
                sleep_motion=0.0,
                rescue=False,
            ),
        )
        body = mesh.rest_vertices, mesh.tets, self.material, self.body.clamped, options
        if scheme == "substeps":
            solver = XpbdSolver(*body, device=device)
        elif scheme == "plain float32":
            solver = PlainSolver(*body)
        else:
            floor = COMPLIANCE_FLOOR if scheme == "iterations" else 0.0
            solver = IterationSolver(*body, iteration_count=count, floor=floor, device=device)
        if self.compliance is not None:
            solver.set_compliances(self.compliance, None)
        return solver


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        compliance: [m/N], or "material".
        count: Substeps or iterations a frame.
        rms, largest: Error, over the size.
        of_motion: RMS error over the reference's RMS displacement.
        frame: Of time; NumPy's, and so of no meaning, with plain float32.
        frames: How many were run.
    """

    scene: str
    lattice: str
    tets: int
    compliance: float | str
    scheme: str
    count: int
    device: str
    rms: float
    largest: float
    of_motion: float
    frame: Timing
    frames: int


def make_case(lattice, spacing, compliance, scene) -> Case:
    body = beam(LATTICES[lattice], spacing)
    rounded = body.mesh.rest_vertices.astype(np.float32).astype(np.float64)
    body = replace(body, mesh=replace(body.mesh, rest_vertices=rounded))
    return Case(lattice, body, compliance, scene)


def measure(case: Case, scheme, count, device, settling_frames=SETTLING_FRAMES) -> Row:
    """One solver's error at the end of a scene, and its time a frame.

    Args:
        settling_frames: At most, until a static scene is still.
    """
    solver = case.solver(scheme, count, device)
    rest = case.body.mesh.rest_vertices
    size = float(np.ptp(rest, axis=0).max())
    times, before, path, frame = [], rest, [], 0
    limit = FALL_FRAMES if case.scene == "dynamic" else settling_frames
    while frame < limit:
        times.append(milliseconds(lambda: solver.step(TIME_STEP), device))
        frame += 1
        if case.scene == "dynamic":
            path.append(solver.vertices.numpy().astype(np.float64))
        if case.scene == "static" and frame % 30 == 0:
            now = solver.vertices.numpy().astype(np.float64)
            if np.abs(now - before).max() < STILL * size:
                break
            before = now
    if case.scene == "static":
        path.append(solver.vertices.numpy().astype(np.float64))
    enough = WARM_UP + (TIMED_FRAMES if scheme != "plain float32" else 1)
    while len(times) < enough:  # the fall alone is too short for a median
        times.append(milliseconds(lambda: solver.step(TIME_STEP), device))
    away = np.linalg.norm(np.array(path) - case.reference, axis=2)
    moved = np.linalg.norm(case.reference - rest, axis=2)
    rms, rms_moved = (float(np.sqrt((a**2).mean())) for a in (away, moved))
    return Row(
        scene=case.scene,
        lattice=case.lattice,
        tets=case.body.mesh.tet_count,
        compliance="material" if case.compliance is None else case.compliance,
        scheme=scheme,
        count=count,
        device=device,
        rms=rms / size,
        largest=float(away.max()) / size,
        of_motion=rms / rms_moved if rms_moved > 0 else float("inf"),
        frame=timing_of(times[WARM_UP:]),
        frames=frame,
    )


def plot(rows, path):
    """Errors of one scene over counts and over milliseconds, a column for each lattice."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from PIL import Image

    lattices, labels = (
        list(dict.fromkeys(column)) for column in zip(*map(_kind, rows), strict=True)
    )
    figure = Figure(figsize=(4.6 * len(lattices), 7.6), layout="constrained")
    axes = figure.subplots(2, len(lattices), sharey=True, squeeze=False)
    for column, lattice in zip(axes.T, lattices, strict=True):
        tets = next(row.tets for row in rows if row.lattice == lattice)
        column[0].set_title(f"{lattice}, {tets} tets, {rows[0].scene}, {rows[0].device}")
        for axis, along in zip(column, (_count, _median), strict=True):
            for index, label in enumerate(labels):
                for scheme, style in SCHEMES.items():
                    line = [r for r in rows if (*_kind(r), r.scheme) == (lattice, label, scheme)]
                    axis.loglog(
                        [along(row) for row in line],
                        [row.rms for row in line],
                        style,
                        color=f"C{index}",
                        markersize=3.5,
                        linewidth=1.1,
                    )
            axis.grid(True, which="major", linewidth=0.4)
        column[0].set_xlabel("substeps or iterations a frame")
        column[1].set_xlabel("ms a frame")
    for axis in axes[:, 0]:
        axis.set_ylabel("RMS error / size")
    colors = [Line2D([], [], color=f"C{i}", label=label) for i, label in enumerate(labels)]
    styles = [
        Line2D([], [], color="gray", linestyle=style[:-1], marker=style[-1], label=scheme)
        for scheme, style in SCHEMES.items()
    ]
    figure.legend(
        handles=colors + styles,
        loc="outside lower center",
        ncols=4,
        fontsize=8,
        frameon=False,
        title="compliance of every edge [m/N], or the default material; scheme",
        title_fontsize=8,
    )
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    # 256 colors are enough, and half of the size.
    Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]).quantize(256).save(
        path, optimize=True
    )


def _kind(row):
    return row.lattice, str(row.compliance)


def _count(row):
    return row.count


def _median(row):
    return row.frame.median
