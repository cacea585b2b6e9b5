"""Native frames in hard cases: tangled and collapsed meshes, threads, blocks, many colors, pace."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import solver_frame
import warp as wp

from deformrf.core.deform import Material, XpbdOptions, XpbdSolver
from deformrf.core.deform.frame import cpu as frame_cpu
from deformrf.core.deform.frame import cuda as frame_cuda
from deformrf.core.geometry import a15_grid, extract

DT = 1.0 / 60.0
OPTIONS = XpbdOptions(substep_count=1, rescue=False, contact=False)


def ball(spacing):
    mesh = a15_grid(spacing)
    away = np.linalg.norm(mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5, axis=1)
    return extract(mesh, away < 0.3)[0]


BALL = ball(0.08)


def make_solver(mesh, device, material=None, options=OPTIONS):
    free = np.zeros(mesh.vertex_count, bool)
    material = material or Material(poisson_ratio=0.4)
    return XpbdSolver(mesh.rest_vertices, mesh.tets, material, free, options, device)


def reference_step(solver, start):
    """Positions of the reference after one frame.  [V, 3]"""
    free_parts = np.zeros(len(start), int) if solver.material.damping else None
    settings = solver_frame.settings_of(solver, DT)
    frame = solver_frame.Frame(**settings, anchors=start, targets=start, free_parts=free_parts)
    return solver_frame.step(frame, start, np.zeros_like(start))[0]


@pytest.mark.parametrize("trial", range(3))
def test_a_tangled_mesh_steps_like_the_reference(device, trial):
    """Random positions: half of the tets are inverted, and most projections are clamped."""
    solver = make_solver(BALL, device)
    start = np.random.default_rng().uniform(0, 1, (BALL.vertex_count, 3))
    start = start.astype(np.float32).astype(np.float64)
    solver.set_state(start)
    solver.step(DT)
    difference = np.abs(solver.vertices.numpy() - reference_step(solver, start)).max(axis=1)
    # Where an edge is nearly of no length, a rounding turns it.
    assert np.quantile(difference, 0.95) < 1e-5
    assert np.isfinite(difference).all()


def test_a_collapsed_mesh_opens_like_the_reference(device):
    """All edges have length 0, so the fixed directions alone decide where vertices go."""
    solver = make_solver(BALL, device)
    start = np.full((BALL.vertex_count, 3), 0.5)
    solver.set_state(start)
    solver.step(DT)
    moved = solver.vertices.numpy()
    assert np.ptp(moved, axis=0).min() > 0.3 * solver.object_size
    difference = np.abs(moved - reference_step(solver, start)).max(axis=1)
    # An edge that is nearly of length 0 after some projections turns with each rounding.
    assert np.quantile(difference, 0.95) < 1e-5
    assert difference.max() < 1e-3


def test_edges_of_length_zero_open_in_their_fixed_directions(device):
    """Edges that share no vertex, in a mesh of loose tets that are points."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]) * 0.1
    count = 40
    rest = (corners + np.random.default_rng().uniform(size=(count, 1, 3))).reshape(-1, 3)
    tets = np.arange(4 * count).reshape(-1, 4)
    material = Material(young_modulus=1e6, poisson_ratio=0.25)
    solver = XpbdSolver(rest, tets, material, np.zeros(4 * count, bool), OPTIONS, device)
    start = np.repeat(rest[::4], 4, axis=0).astype(np.float32).astype(np.float64)
    solver.set_state(start)
    solver.step(DT)
    expected = reference_step(solver, start)
    np.testing.assert_allclose(solver.vertices.numpy(), expected, atol=2e-6)


def test_edges_of_zero_compliance_between_handles_stay_finite(device):
    solver = make_solver(BALL, device, options=XpbdOptions(rescue=False))
    solver.set_compliances(0.0, 0.0)
    held = np.flatnonzero(BALL.rest_vertices[:, 2] > 0.5)
    solver.grab(held)
    for _ in range(3):
        solver.move(BALL.rest_vertices[held] + [0.05, 0.0, 0.0])
        solver.step(DT)
    assert np.isfinite(solver.vertices.numpy()).all()


def shaken(mesh):
    size = mesh.rest_vertices.shape
    return mesh.rest_vertices + np.random.default_rng().normal(scale=0.003, size=size)


def test_results_are_bitwise_equal_for_any_number_of_threads():
    mesh, results = ball(0.04), []
    start = shaken(mesh)
    for thread_count in (1, 2, 3):
        solver = make_solver(mesh, "cpu", options=XpbdOptions())
        solver._frame._pace.thread_count = thread_count
        solver._frame._pace.note = lambda seconds: None
        solver.set_state(start)
        for _ in range(3):
            solver.step(DT)
        results.append(solver.vertices.numpy().copy())
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


def test_an_interrupt_of_the_calling_thread_ends_the_helpers(monkeypatch):
    """Ctrl-C before the calling thread's part: the helpers end by themselves."""
    solver = make_solver(ball(0.04), "cpu", options=XpbdOptions(contact=False))
    solver._frame._pace.thread_count = 2
    solver._frame._pace.note = lambda seconds: None
    solver.set_state(shaken(ball(0.04)))
    solver.step(DT)
    key = next(iter(solver._frame._launches))
    mine = solver._frame._launches[key][0]

    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(mine, "launch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        solver.step(DT)
    monkeypatch.undo()
    solver.reset()
    solver.set_state(shaken(ball(0.04)))
    solver.step(DT)
    assert np.isfinite(solver.vertices.numpy()).all()


def test_an_interrupt_while_helpers_start_ends_those_that_run(monkeypatch):
    """Ctrl-C between the helpers: those that run already end by themselves."""
    mesh = ball(0.04)
    solver = make_solver(mesh, "cpu", options=XpbdOptions(contact=False))
    solver._frame._pace.thread_count = 3
    solver._frame._pace.note = lambda seconds: None
    solver.set_state(shaken(mesh))
    solver.step(DT)
    helpers, asked = frame_cpu._helpers(), []

    class Interrupted:
        def submit(self, *call):
            if asked:
                raise KeyboardInterrupt
            asked.append(call)
            return helpers.submit(*call)

    monkeypatch.setattr(frame_cpu, "_helpers", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        solver.step(DT)
    monkeypatch.undo()
    solver.set_state(shaken(mesh))
    solver.step(DT)
    assert np.isfinite(solver.vertices.numpy()).all()


def test_two_solvers_may_step_in_two_threads():
    mesh = ball(0.06)
    solvers = [make_solver(mesh, "cpu", options=XpbdOptions()) for _ in range(2)]
    for solver in solvers:
        # Together more than there are helpers.
        solver._frame._pace.thread_count = frame_cpu.MOST_THREADS
        solver._frame._pace.note = lambda seconds: None
        solver.set_state(shaken(mesh))
        solver.step(DT)

    def run(solver):
        for _ in range(3):
            solver.step(DT)
        return solver.vertices.numpy().copy()

    with ThreadPoolExecutor(2) as pool:
        for x in pool.map(run, solvers, timeout=60):
            assert np.isfinite(x).all()


@pytest.mark.parametrize("kernel", ["begin", "block", "grid"])
def test_the_gpu_source_compiles_without_a_gpu(kernel, tmp_path):
    module = getattr(frame_cuda, f"{kernel}_kernel").module
    assert wp.compile_aot_module(module, arch=90, module_dir=tmp_path)


@pytest.mark.gpu
def test_too_many_colors_are_refused_and_many_are_solved():
    """A fan of tets around one edge has as many colors as tets."""
    for count, fits in ((frame_cuda.MOST_COLORS // 2 - 10, True), (400, False)):
        angles = np.arange(count + 1) * 0.4 / count
        rim = np.stack([np.cos(angles), np.sin(angles), 0 * angles + 0.5], axis=1)
        vertices = np.concatenate([[[0, 0, 0], [0, 0, 1.0]], rim])
        ids = np.arange(count)
        tets = np.stack([0 * ids, 0 * ids + 1, ids + 2, ids + 3], axis=1)
        arguments = vertices, tets, Material(), np.zeros(len(vertices), bool), OPTIONS, "cuda:0"
        if not fits:
            with pytest.raises(ValueError, match="colors"):
                XpbdSolver(*arguments)
            continue
        solver = XpbdSolver(*arguments)
        solver.set_state(1.01 * vertices)
        solver.step(DT)
        assert np.isfinite(solver.vertices.numpy()).all()


@pytest.mark.gpu
def test_a_block_and_a_grid_agree(monkeypatch):
    mesh, results = ball(0.03), []
    start = shaken(mesh)
    assert frame_cuda.runs_in_block(mesh.vertex_count)
    for in_block in (True, False):
        monkeypatch.setattr(frame_cuda, "runs_in_block", lambda count, answer=in_block: answer)
        solver = make_solver(mesh, "cuda:0", options=XpbdOptions())
        solver.set_state(start)
        for _ in range(3):
            solver.step(DT)
        results.append(solver.vertices.numpy().copy())
    np.testing.assert_allclose(*results, atol=2e-7)


@pytest.mark.gpu
def test_a_large_mesh_runs_on_the_grid_and_agrees_with_a_cpu():
    mesh = ball(0.017)
    assert mesh.vertex_count > frame_cuda.SHARED_VERTICES
    start, results = shaken(mesh), []
    for name in ("cpu", "cuda:0"):
        solver = make_solver(mesh, name, options=XpbdOptions(substep_count=5))
        solver.set_state(start)
        solver.step(DT)
        results.append(solver.vertices.numpy().copy())
    np.testing.assert_allclose(*results, atol=2e-6)


def test_translates_have_different_banks():
    """Eight neighboring cells keep a vertex of the same kind in eight banks."""
    mesh = a15_grid(0.1)
    slots = frame_cuda.bank_slots(mesh.rest_vertices)
    assert len(np.unique(slots)) == len(slots)
    bank = dict(zip(map(tuple, mesh.addresses.tolist()), slots % frame_cuda.BANKS, strict=True))
    cells = np.array(np.meshgrid([4, 8], [4, 8], [4, 8])).reshape(3, -1).T
    for site in ([0, 0, 0], [1, 2, 0], [2, 2, 2]):
        assert {bank[tuple(cell + site)] for cell in cells} == set(range(8))


def test_meshes_of_no_lattice_get_slots():
    points = np.random.default_rng().uniform(size=(50, 3))
    assert frame_cuda.bank_slots(points).tolist() == list(range(50))


def thread_counts(paced, seconds, frame_count):
    """Thread counts of so many frames that last what `seconds` says for each count."""
    counts = []
    for _ in range(frame_count):
        counts.append(paced.thread_count)
        paced.note(seconds[paced.thread_count] * np.random.default_rng().uniform(1.0, 1.05))
    return np.array(counts)


def test_threads_that_help_are_kept():
    counts = thread_counts(frame_cpu.Pace(4), {1: 2.0, 4: 1.0}, 2000)
    assert (counts == 4).mean() > 0.95
    assert (counts == 1).sum() >= frame_cpu.TRIAL


def test_slower_threads_are_dropped_and_tried_less_often():
    counts = thread_counts(frame_cpu.Pace(4), {1: 1.0, 4: 50.0}, 4000)
    assert (counts == 4).sum() <= 8 * frame_cpu.TRIAL
    assert counts[-100:].max() == 1


def test_a_machine_that_gets_busy_or_free_is_noticed():
    paced = frame_cpu.Pace(2)
    thread_counts(paced, {1: 2.0, 2: 1.0}, 200)
    assert paced.thread_count == 2
    thread_counts(paced, {1: 2.0, 2: 30.0}, 20)
    assert paced.thread_count == 1
    thread_counts(paced, {1: 2.0, 2: 1.0}, frame_cpu.LONGEST_PAUSE + 20)
    assert paced.thread_count == 2


def test_one_thread_stays_one():
    assert set(thread_counts(frame_cpu.Pace(1), {1: 1.0}, 50)) == {1}


def test_small_meshes_have_one_thread():
    assert frame_cpu.thread_limit(500) == 1
    assert 1 <= frame_cpu.thread_limit(10**6) <= frame_cpu.MOST_THREADS
