"""A mesh that is cut in two for two threads: what is in each half, and frames of it."""

from itertools import pairwise

import numpy as np
import pytest

from deformrf.core.deform import Box, Material, XpbdOptions, XpbdSolver, constraints, halves, xpbd
from deformrf.core.deform.arrays import CPU_GROUP
from deformrf.core.geometry import a15_grid, extract

DT = 1.0 / 60.0


def ball(spacing):
    mesh = a15_grid(spacing)
    away = np.linalg.norm(mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5, axis=1)
    return extract(mesh, away < 0.3)[0]


BALL = ball(0.05)
LISTS = [
    make(BALL.rest_vertices, BALL.tets)
    for make in (constraints.edge_constraints, constraints.volume_constraints)
]


@pytest.fixture
def cut_always(monkeypatch):
    cut_all(monkeypatch)


def cut_all(monkeypatch, fewest=0):
    monkeypatch.setattr(halves, "FEWEST_TETS", fewest)
    monkeypatch.setattr(halves, "MOST_SHARED", 1.0)
    monkeypatch.setattr(xpbd, "takes_halves", lambda: True)  # whatever this machine has


def test_halves_share_the_vertices_of_what_joins_them(cut_always):
    found = halves.cut(BALL.rest_vertices, *LISTS)
    np.testing.assert_array_equal(np.sort(found.order), np.arange(BALL.vertex_count))
    sizes = np.diff(found.starts)
    assert abs(sizes[:2].sum() - sizes[2:].sum()) < 0.1 * BALL.vertex_count
    assert sizes[1:3].sum() < 0.5 * BALL.vertex_count
    np.testing.assert_array_equal(
        found.second[found.order], np.arange(len(found.order)) >= found.starts[2]
    )
    for part in LISTS:
        sections = found.sections(part)
        sides, shared = found.second[part.vertices], found.shared[part.vertices]
        joining = sides.any(axis=1) & ~sides.all(axis=1)
        assert joining.any() and shared[joining].all()
        # What isn't near touches no vertex that the other half's constraints touch.
        assert not sides[sections == 0].any() and not shared[sections == 0].any()
        assert sides[sections == 3].all() and not shared[sections == 3].any()
        assert shared[(sections == 1) | (sections == 2)].any(axis=1).all()


def test_meshes_that_would_gain_nothing_are_not_cut(monkeypatch):
    assert len(LISTS[1].vertices) < halves.FEWEST_TETS
    assert halves.cut(BALL.rest_vertices, *LISTS) is None
    monkeypatch.setattr(halves, "FEWEST_TETS", 0)
    assert halves.cut(BALL.rest_vertices, *LISTS) is None  # too much is shared


def test_sections_begin_with_whole_groups_in_the_order_of_colors(cut_always):
    solver = solver_of(XpbdOptions())
    found = halves.cut(BALL.rest_vertices, *LISTS)
    solver.step(DT)  # few tets hold the volume: most colors of tets are empty
    for chosen, part in zip(solver._lists, LISTS, strict=True):
        arrays = chosen.arrays
        count = arrays.color_count.numpy()[0]
        begins = arrays.sections.numpy()[: 4 * count + 1]
        assert (begins % CPU_GROUP == 0).all() and (np.diff(begins) >= 0).all()
        np.testing.assert_array_equal(begins[::4], arrays.offsets.numpy()[: count + 1])
        ids, vertices = arrays.ids.numpy(), arrays.vertices.numpy()
        color_of = np.repeat(np.arange(len(part.offsets) - 1), np.diff(part.offsets))
        seen, colors = [], []
        for section, (first, last) in enumerate(pairwise(begins)):
            used = ids[first:last][vertices[first:last, 0] < BALL.vertex_count]
            assert (found.sections(part)[used] == section % 4).all()
            colors += np.unique(color_of[used]).tolist()
            seen += used.tolist()
        assert colors == sorted(colors)
        assert sorted(seen) == sorted(chosen.in_use)


def solver_of(options, **material):
    free = np.zeros(BALL.vertex_count, bool)
    arguments = BALL.rest_vertices, BALL.tets, Material(**material), free, options, "cpu"
    return XpbdSolver(*arguments)


def run(thread_count, noise):
    """Positions after a drag by springs, with a ground, a box, and contact."""
    options = XpbdOptions(
        gravity=(0.0, 0.0, -9.81), ground=0.1, colliders=(Box((0.5, 0.5, 0.1), (0.1, 0.1, 0.2)),)
    )
    solver = solver_of(options, young_modulus=3e4)
    solver._frame._pace.thread_count = thread_count
    solver._frame._pace.note = lambda seconds: None
    solver.set_state(BALL.rest_vertices + noise)
    top = np.flatnonzero(BALL.rest_vertices[:, 2] > 0.75)
    solver.grab(top, stiffness=1e4)
    for step in range(20):
        solver.move(BALL.rest_vertices[top] - [0.0, 0.0, 0.02 * (step + 1)])
        solver.step(DT)
    return solver.vertices.numpy().copy()


def test_results_have_the_same_bits_without_halves_and_with_any_number_of_threads(monkeypatch):
    noise = np.random.default_rng().normal(scale=0.004, size=BALL.rest_vertices.shape)
    whole = run(1, noise)
    assert np.abs(whole - BALL.rest_vertices).max() > 0.1
    cut_all(monkeypatch)
    for thread_count in (1, 2, 3):
        np.testing.assert_array_equal(run(thread_count, noise), whole)


def test_parts_at_rest_are_left_out_of_both_halves(cut_always):
    """A half whose constraints are not in use waits for the other all the same."""
    results = []
    for thread_count in (1, 2):
        solver = solver_of(XpbdOptions())
        solver._frame._pace.thread_count = thread_count
        solver._frame._pace.note = lambda seconds: None
        solver.set_pinned(solver.rest_vertices[:, 2] < 0.5)
        solver.grab(top := np.flatnonzero(BALL.rest_vertices[:, 2] > 0.75))
        for _ in range(5):
            solver.move(BALL.rest_vertices[top] + [0.05, 0.0, 0.0])
            solver.step(DT)
        results.append(solver.vertices.numpy().copy())
    np.testing.assert_array_equal(*results)


def test_bodies_that_touch_have_the_same_bits_with_halves(monkeypatch):
    """Contacts join vertices of both halves, so they wait for all constraints."""
    grid = a15_grid(0.04)
    middles = grid.rest_vertices[grid.tets].mean(axis=1) - 0.5
    near = np.linalg.norm(middles, axis=1) < 0.3
    mesh = extract(grid, near & (np.abs(middles[:, 2]) > 0.06))[0]  # two bowls, one over the other
    upper = np.flatnonzero(mesh.rest_vertices[:, 2] > 0.7)
    results = []
    for thread_count, fewest in ((1, 10**9), (1, 0), (2, 0), (2, 0), (3, 0)):
        cut_all(monkeypatch, fewest)
        free = np.zeros(mesh.vertex_count, bool)
        arguments = mesh.rest_vertices, mesh.tets, Material(young_modulus=1e5), free
        solver = XpbdSolver(*arguments, XpbdOptions(rescue=False), "cpu")
        solver._frame._pace.thread_count = thread_count
        solver._frame._pace.note = lambda seconds: None
        solver.set_pinned(mesh.rest_vertices[:, 2] < 0.3)
        solver.grab(upper)
        touched = 0
        for step in range(25):
            solver.move(mesh.rest_vertices[upper] - [0.0, 0.0, 0.01 * (step + 1)])
            solver.step(DT)
            touched += solver._contact.found()
        assert touched > 5
        results.append(solver.vertices.numpy().copy())
    for result in results[1:]:
        np.testing.assert_array_equal(result, results[0])
