"""How exactly the solver moves, bends and comes to rest: one table.

    python tests/benchmarks/dynamics.py --quick
    python tests/benchmarks/dynamics.py --rows loads motion --substeps 12 16 24 --device cuda:0

References are converged and float64: Newton's method, Verlet and modes of the energy that the
solver minimizes (wings/lab/dynamics), and quadratic elements on the same tets.

    loads    pushed along each axis: error of the pose, in % of the motion
    motion   the first 0.2 s after such a push, undamped
    poisson  a cantilever's sag against the energy's and against quadratic elements
    sheets   the same of sheets 1 to 2 cells thick, cut from the lattice at four heights;
             ∞ substeps stand for the energy, the worst of three ν
    wobble   rate at which a mode of vibration dies without damping; exact is 0
    spin     angular momentum that a free body loses, without damping; exact is 0
    stack    seconds until cubes on each other sleep, or how far they move in a frame after 4 s
    drop     the same of a free body that falls 5 cm, after 20 s
    release  seconds until a body that was bent by a quarter of its size sleeps
    bending  modulus that a bending test measures, and the panel's number, over that asked for
    column   the same under a load along a column
    speed    ms a frame while a handle is dragged
"""

import argparse
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from elastic_bodies import (
    AWAKE,
    bundled,
    cantilever,
    default_count,
    energy_of,
    free,
    held_beam,
    load,
    longest_side,
    make_solver,
    modes,
    quadratic_sag,
    sheet,
    stack,
)

from deformrf.core.base.device import start_warp
from deformrf.core.deform import TIME_STEP, Material
from deformrf.wings.lab.dynamics.measure import measure
from deformrf.wings.lab.stopwatch import milliseconds

AXES = dict(zip("xyz", np.eye(3), strict=True))  # z: downwards a standing body would buckle
DOWN = (0.0, 0.0, -1.0)
GRAVITY = (0.0, 0.0, -9.81)
PUSH, SMALL = 0.05, 0.01  # of the size
RATIOS = (0.35, 0.45, 0.49)
MODULI = 1e6, 3e6, 1e7, 3e7, 1e8, 3e8, 1e9  # Pa
FREQUENCIES = 1.0, 7.5, 19.7  # Hz
LONGEST = 20.0  # s until something counts as restless
TIMED_FRAMES = 300


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    row: str
    case: str
    substeps: int
    measured: float  # inf where something never rests
    unit: str
    ms: float | None = None  # a frame, median


@dataclass(frozen=True)
class Setup:
    """What the command line chooses."""

    device: str
    model: str
    counts: tuple[int, ...] | None  # of substeps; None: the program's for the body and material
    quick: bool

    def substeps(self, body, material=None):
        return self.counts or (default_count(body, material or Material()),)


def loads(setup):
    body = bundled(setup.model)
    for axis, direction in AXES.items():
        for contact in (True,) if setup.quick else (False, True):
            case = load(body, "static", direction, PUSH, contact=contact)
            for count in setup.substeps(body):
                row = measure(case, count, setup.device)
                words = f"along {axis}, contact {'on' if contact else 'off'}"
                yield Row("loads", words, count, row.of_motion, "% of motion", row.frame.median)


def motion(setup):
    body = bundled(setup.model)
    case = load(body, "dynamic", AXES["x"], PUSH)
    for count in setup.substeps(body):
        row = measure(case, count, setup.device)
        yield Row("motion", "along x", count, row.of_motion, "% of motion", row.frame.median)


def poisson(setup):
    for spacing in (1 / 32,) if setup.quick else (1 / 32, 1 / 48):
        beam = cantilever(spacing)
        body = held_beam(beam)
        for ratio in RATIOS:
            case = load(body, "static", DOWN, SMALL, Material(poisson_ratio=ratio))
            exact = beam.tip(case.reference[0][0] - body.rest)[2]
            elements = beam.tip(quadratic_sag(beam, case.material, case.gravity))[2]
            words = f"{len(body.tets)} tets, ν {ratio}"
            for count in setup.substeps(body, case.material):
                sag = beam.tip(case.settled(count, setup.device)[1])[2]
                yield Row("poisson", words, count, percent(sag, exact), "% of the energy's sag")
                yield Row("poisson", words, count, percent(sag, elements), "% of P2's sag")


def sheets(setup):
    """The energy's sag; for the first cut the solver's own, too, at the default ν."""
    default = Material().poisson_ratio
    for cells in (1, 1.5, 2):
        for cut in (0.0, 0.25, 0.5, 0.75):
            beam = sheet(cells, cut)
            body, words, errors = held_beam(beam), f"{cells:g} cells, cut at {cut:g}", []
            for ratio in (default,) if setup.quick else (0.25, default, 0.45):
                case = load(body, "static", DOWN, SMALL, Material(poisson_ratio=ratio))
                elements = beam.tip(quadratic_sag(beam, case.material, case.gravity))[2]
                errors.append(percent(beam.tip(case.response)[2], elements))
                for count in setup.substeps(body) if (cut, ratio) == (0.0, default) else ():
                    sag = beam.tip(case.settled(count, setup.device)[1])[2]
                    yield Row("sheets", words, count, percent(sag, elements), "% of P2's sag")
            yield Row("sheets", words, math.inf, max(errors, key=abs), "% of P2's sag")


def wobble(setup):
    body, material = bundled(setup.model), Material(damping=0.0)
    for frequency in FREQUENCIES:
        energy = energy_of(body, material)
        omegas, shapes = modes(body, energy, frequency)
        words = f"mode of {omegas[0] / (2.0 * math.pi):.2f} Hz"
        for count in setup.substeps(body, material):
            solver = make_solver(body, material, count, setup.device, **AWAKE)
            yield Row("wobble", words, count, decay(solver, energy.masses, omegas, shapes), "1/s")


def decay(solver, masses, omegas, shapes, size=1e-3, seconds=2.0):
    """The rate [1/s] at which the amplitude of the first mode falls, from a size [m].

    It is that of the root of the energy in all of the modes, until a tenth is left.
    """
    rest = solver.rest_vertices
    solver.set_state(rest + size / np.linalg.norm(shapes[0], axis=1).max() * shapes[0])
    weighted = masses[:, None] * shapes
    amplitudes = []
    for _ in range(round(seconds / TIME_STEP)):
        solver.step(TIME_STEP)
        away = solver.vertices.numpy().astype(np.float64) - rest
        parts = (
            np.tensordot(weighted, away, 2),
            np.tensordot(weighted, solver.velocities.numpy(), 2),
        )
        amplitudes.append(math.sqrt(((omegas * parts[0]) ** 2 + parts[1] ** 2).sum()))
    amplitudes = np.array(amplitudes)
    low = np.flatnonzero(amplitudes < 0.1 * amplitudes[0])
    last = max(low[0], 3) if len(low) else len(amplitudes)
    times = TIME_STEP * np.arange(last)
    return -float(np.polyfit(times, np.log(amplitudes[:last]), 1)[0])


def spin(setup):
    body, material = free(bundled(setup.model)), Material(damping=0.0)
    masses = energy_of(body, material).masses[:, None]
    away = body.rest - (masses * body.rest).sum(axis=0) / masses.sum()
    axes = np.linalg.eigh((masses * away).T @ away)[1].T  # the first has the largest moment
    for words, axis in {"largest moment": axes[0], "smallest moment": axes[2]}.items():
        for count in setup.substeps(body, material):
            solver = make_solver(body, material, count, setup.device, **AWAKE)
            solver.set_state(body.rest, np.cross(2.0 * math.pi * axis, away))
            start = np.linalg.norm(angular_momentum(solver, masses))
            for seconds in (1,) if setup.quick else (1, 9):
                run(solver, seconds)
                left = np.linalg.norm(angular_momentum(solver, masses)) / start
                when = f"{words}, {1 if seconds == 1 else 10} s"
                yield Row("spin", when, count, 100.0 * (1.0 - left), "% lost")


def angular_momentum(solver, masses):
    """About the center of mass [kg m²/s].  [3]"""
    x, v = solver.vertices.numpy().astype(np.float64), solver.velocities.numpy()
    away = x - (masses * x).sum(axis=0) / masses.sum()
    return (masses * np.cross(away, v)).sum(axis=0)


def drop(setup):
    body = free(bundled(setup.model))
    options = {"gravity": GRAVITY, "ground": float(body.rest[:, 2].min()) - 0.05}
    for count in setup.substeps(body):
        solver = make_solver(body, Material(), count, setup.device, **options)
        yield Row("drop", "5 cm", count, *rest_or_motion(solver, LONGEST))


def rest_or_motion(solver, longest):
    """When it sleeps, or how far a vertex goes in a frame after so many seconds; the unit."""
    seconds = seconds_to_sleep(solver, longest)
    if seconds < math.inf:
        return seconds, "s until it sleeps"
    return 1e6 * run(solver, 0.25).max(), f"µm a frame after {longest:g} s"


def seconds_to_sleep(solver, longest):
    """Simulated seconds until the solver sleeps; inf if it doesn't."""
    for frame in range(round(longest / TIME_STEP)):
        if solver.settled:
            return frame * TIME_STEP
        solver.step(TIME_STEP)
    return math.inf


def run(solver, seconds):
    """The farthest that a vertex moves in each frame [m].  [frames]"""
    moves, before = [], solver.vertices.numpy().astype(np.float64)  # a copy
    for _ in range(round(seconds / TIME_STEP)):
        solver.step(TIME_STEP)
        now = solver.vertices.numpy().astype(np.float64)
        moves.append(np.linalg.norm(now - before, axis=1).max())
        before = now
    return np.array(moves)


def stacks(setup):
    for cubes in (2, 4) if setup.quick else (2, 3, 4, 6):
        for modulus in (1e6,) if setup.quick else (1e6, 1e8):
            for count in setup.counts or ((24,) if setup.quick else (24, 48, 96)):
                options = {"gravity": GRAVITY, "ground": 0.0}
                material = Material(young_modulus=modulus)
                solver = make_solver(stack(cubes), material, count, setup.device, **options)
                words = f"{cubes} cubes, {modulus / 1e6:g} MPa"
                yield Row("stack", words, count, *rest_or_motion(solver, 4.0))


def release(setup):
    body = bundled(setup.model)
    top = top_of(body)
    bend = 0.25 * longest_side(body.rest)
    for count in setup.substeps(body):
        seconds = []
        for sideways in (AXES["x"], -AXES["x"], AXES["y"], -AXES["y"]):
            solver = make_solver(body, Material(), count, setup.device)
            solver.grab(top)
            # It takes a second to get there, and is held for half a second.
            for share in np.minimum(1.0, np.arange(1, 91) / 60.0):
                solver.move(body.rest[top] + share * bend * sideways)
                solver.step(TIME_STEP)
            solver.release()
            seconds.append(seconds_to_sleep(solver, LONGEST))
        mean = float(np.mean(seconds))
        yield Row("release", "mean of four directions", count, mean, "s until it sleeps")


def top_of(body):
    """Vertices in the uppermost tenth.  [K]"""
    z = body.rest[:, 2]
    return np.flatnonzero(z > z.max() - 0.1 * np.ptp(z))


def bending(setup):
    bodies = {"beam": held_beam(cantilever(1 / 32)), setup.model: bundled(setup.model)}
    directions = {"beam": DOWN, setup.model: AXES["x"]}
    for name, body in bodies.items():
        yield from moduli(setup, "bending", name, body, directions[name])


def column(setup):
    yield from moduli(setup, "column", "beam", held_beam(cantilever(1 / 32)), AXES["x"])


def moduli(setup, row, name, body, direction):
    """Real and claimed moduli over those asked for.

    The real one is the asked one times the way that a linear body's mass moves along the load,
    over the way of the solver's.
    """
    for modulus in MODULI[::2] if setup.quick else MODULI:
        material = Material(young_modulus=modulus)
        for count in setup.substeps(body, material):
            solver = make_solver(body, material, count, setup.device)
            claimed = solver.held_young_modulus() / modulus
            case = load(body, "static", direction, SMALL * min(1.0, claimed), material)
            works = [
                float((case.energy.masses[:, None] * u * case.gravity).sum())
                for u in (case.response, case.settled(count, setup.device)[1])
            ]
            real, words = works[0] / works[1], f"{name}, {modulus / 1e6:g} MPa"
            yield Row(row, words, count, real, "real / asked")
            yield Row(row, words, count, claimed / real, "claimed / real")


def speed(setup):
    """Substeps take turns, so that other load on the machine affects all."""
    body = bundled(setup.model)
    top = top_of(body)
    counts = setup.substeps(body)
    solvers = [make_solver(body, Material(), count, setup.device) for count in counts]
    for solver in solvers:
        solver.grab(top)
    times = np.empty((60 if setup.quick else TIMED_FRAMES, len(solvers)))
    for frame, line in enumerate(times):
        sway = [0.1 * math.sin(frame * TIME_STEP), 0.0, 0.0]
        for place, solver in enumerate(solvers):
            solver.move(body.rest[top] + sway)
            line[place] = milliseconds(lambda: solver.step(TIME_STEP), setup.device)  # noqa: B023
    for count, median in zip(counts, np.median(times, axis=0).tolist(), strict=True):
        yield Row("speed", "dragged", count, median, "ms a frame", median)


def percent(value, exact):
    return 100.0 * float(value / exact - 1.0)


ROWS = {
    "loads": loads,
    "motion": motion,
    "poisson": poisson,
    "sheets": sheets,
    "wobble": wobble,
    "spin": spin,
    "drop": drop,
    "stack": stacks,
    "release": release,
    "bending": bending,
    "column": column,
    "speed": speed,
}


def line(row):
    """A line of the table in Markdown."""
    count = row.substeps if row.substeps < math.inf else "∞"
    measured = f"{row.measured:.3g}" if row.measured < math.inf else "never"
    time = "" if row.ms is None else f"{row.ms:.2f}"
    return f"| {row.row} | {row.case} | {count} | {measured} | {row.unit} | {time} |"


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--device", default="cpu", help="cpu or cuda:0")
    parser.add_argument("--rows", nargs="+", default=list(ROWS), choices=ROWS, metavar="NAME")
    parser.add_argument("--model", default="helmet", help="helmet, fox or a model file")
    parser.add_argument("--substeps", type=int, nargs="+", help="the program's own by default")
    parser.add_argument("--quick", action="store_true", help="fewer cases")
    parser.add_argument("--out", type=Path, help="a JSON file of the table")
    arguments = parser.parse_args()
    start_warp()
    counts = arguments.substeps and tuple(arguments.substeps)
    setup = Setup(arguments.device, arguments.model, counts, arguments.quick)
    print("| row | case | substeps | measured | unit | ms a frame |")
    print("|---|---|---|---|---|---|")
    rows = []
    for name in arguments.rows:
        for row in ROWS[name](setup):
            rows.append(row)
            print(line(row), flush=True)
    if arguments.out:
        lines = [asdict(row) for row in rows]
        arguments.out.write_text(json.dumps(lines, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
