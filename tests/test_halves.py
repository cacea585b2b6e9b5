"""A mesh that is cut in two for two threads: what is in each half, and frames of it."""

import numpy as np
import pytest

from deformrf.core.deform import Box, Material, XpbdOptions, XpbdSolver, constraints, halves
from deformrf.core.deform.frame import reference
from deformrf.core.geometry import a15_grid, extract

DT = 1.0 / 60.0


def ball(spacing):
    mesh = a15_grid(spacing)
    away = np.linalg.norm(mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5, axis=1)
    return extract(mesh, away < 0.3)[0]


BALL = ball(0.06)


@pytest.fixture
def cut_always(monkeypatch):
    monkeypatch.setattr(halves, "FEWEST_TETS", 0)


def solver_of(mesh, options, **material):
    free = np.zeros(mesh.vertex_count, bool)
    return XpbdSolver(mesh.rest_vertices, mesh.tets, Material(**material), free, options, "cpu")


def test_each_half_has_its_own_constraints(cut_always):
    lists = [
        make(BALL.rest_vertices, BALL.tets)
        for make in (constraints.edge_constraints, constraints.volume_constraints)
    ]
    *cut, slots = halves.cut(BALL.rest_vertices, *lists)
    second = np.zeros(BALL.vertex_count, bool)
    second[slots.order[slots.first_count :]] = True
    np.testing.assert_array_equal(np.sort(slots.order), np.arange(BALL.vertex_count))
    for before, after in zip(lists, cut, strict=True):
        assert sorted(map(tuple, after.vertices)) == sorted(map(tuple, before.vertices))
        count = (len(after.offsets) - 1) // 3
        runs = [slice(*after.offsets[[i * count, (i + 1) * count]]) for i in range(3)]
        sides = [second[after.vertices[run]] for run in runs]
        assert not sides[0].any() and sides[1].all()
        assert (sides[2].any(axis=1) & ~sides[2].all(axis=1)).all()
        sizes = [len(side) for side in sides]
        assert max(sizes[:2]) < 1.25 * min(sizes[:2]) and sizes[2] < 1.25 * min(sizes[:2])
        for first, last in zip(after.offsets[:-1], after.offsets[1:], strict=True):
            assert len(np.unique(after.vertices[first:last])) == after.vertices[first:last].size
        order = {tuple(v): i for i, v in enumerate(before.vertices)}
        moved = [order[tuple(v)] for v in after.vertices]
        np.testing.assert_array_equal(after.rest_values, before.rest_values[moved])


def test_meshes_of_other_sizes_are_not_cut():
    edges = constraints.edge_constraints(BALL.rest_vertices, BALL.tets)
    volumes = constraints.volume_constraints(BALL.rest_vertices, BALL.tets)
    assert len(volumes.vertices) < halves.FEWEST_TETS
    assert halves.cut(BALL.rest_vertices, edges, volumes) == (edges, volumes, None)


@pytest.mark.parametrize("poisson_ratio", [0.25, 0.45])
def test_a_cut_mesh_steps_like_the_reference(cut_always, poisson_ratio):
    options = XpbdOptions(substep_count=2, rescue=False, contact=False)
    solver = solver_of(BALL, options, poisson_ratio=poisson_ratio)
    noise = np.random.default_rng().normal(scale=0.004, size=BALL.rest_vertices.shape)
    start = np.float32(BALL.rest_vertices + noise).astype(np.float64)
    solver.set_state(start)
    solver.step(DT)
    material, edges, volumes = solver.material, solver.edges, solver.volumes
    assert edges.has_halves and volumes.has_halves
    w = 1.0 / constraints.lumped_masses(solver.rest_vertices, solver.tets, material.density)
    of_edges, of_volumes = material.compliances(edges, volumes)
    h = DT / options.substeps(DT)
    frame = reference.Frame(
        options.timing(DT, material.damping, solver.object_size),
        options.substeps(DT),
        w,
        start,
        start,
        edges,
        edges.regularization(of_edges, w, h),
        None if of_volumes is None else volumes,
        None if of_volumes is None else volumes.regularization(of_volumes, w, h),
        free_parts=np.zeros(len(w), int),
    )
    expected = reference.step(frame, start, np.zeros_like(start))[0]
    np.testing.assert_allclose(solver.vertices.numpy(), expected, atol=2e-6)


def test_results_are_bitwise_equal_for_any_number_of_threads(cut_always):
    """With springs, a ground, a collider, and a body that touches itself."""
    options = XpbdOptions(
        gravity=(0.0, 0.0, -9.81), ground=0.1, colliders=(Box((0.5, 0.5, 0.1), (0.1, 0.1, 0.2)),)
    )
    noise = np.random.default_rng().normal(scale=0.004, size=BALL.rest_vertices.shape)
    results = []
    for thread_count in (1, 2, 3):
        solver = solver_of(BALL, options, young_modulus=3e4)
        solver._frame._pace.thread_count = thread_count
        solver._frame._pace.note = lambda seconds: None
        solver.set_state(BALL.rest_vertices + noise)
        top = np.flatnonzero(BALL.rest_vertices[:, 2] > 0.75)
        solver.grab(top, stiffness=1e4)
        for step in range(20):
            solver.move(BALL.rest_vertices[top] - [0.0, 0.0, 0.02 * (step + 1)])
            solver.step(DT)
        results.append(solver.vertices.numpy().copy())
    assert np.abs(results[0] - BALL.rest_vertices).max() > 0.1
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])
