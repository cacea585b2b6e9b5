"""Surroundings: where their pieces lie, what a pixel is made of, and that they are learnt apart."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import warp as wp
from ball_photos import photographs
from contracted_grid import contract

from deformrf.core.field import basis_vector, modelfile
from deformrf.core.training import evaluate, preset, trainer
from deformrf.core.training.run.surroundings import (
    BEHIND_PIECES,
    FRONT_PIECES,
    NEAR,
    LearnedSurroundings,
    over,
    pieces_kernel,
    random_surroundings,
    surrounded_cost,
)

BOX = np.array([[0.2, 0.1, 0.3], [0.8, 0.9, 0.7]])
PIECES = FRONT_PIECES + BEHIND_PIECES


def test_rays_cost_least_where_they_end_in_the_object_or_miss_it():
    """The distortion of a ray with one sample more, behind the object, and a price in front."""
    rng = np.random.default_rng()
    w = rng.dirichlet(np.ones(6))[:5]  # what is missing to 1 is behind
    t = np.sort(rng.uniform(0.0, 1e-9, 5))  # so that all are half a unit before it
    behind = 1.0 - w.sum()
    everything, places = np.append(w, behind), np.append(t, 0.5)
    gaps = np.abs(places[:, None] - places)
    opacity, front = torch.tensor([w.sum(), 0.0, 1.0]), torch.tensor([0.3, 0.0, 0.0])
    cost = surrounded_cost(1e-2, torch.zeros(3, dtype=torch.float64), opacity, front)
    expected = 0.1 * 1e-2 * (everything @ gaps @ everything) + 1e-2 * 0.3
    np.testing.assert_allclose(cost.numpy(), [expected, 0.0, 0.0], atol=1e-9)
    assert surrounded_cost(1e-2, 0.7, opacity, front)[1] == pytest.approx(0.1 * 1e-2 * 0.7)


def on_device(rays, device):
    return [wp.array(a.astype(np.float32), dtype=wp.vec3, device=device) for a in rays]


def pieces(origins, directions, device, seed=0):
    """points, length, t of all pieces, front to back: [R, K_f + K_b] each."""
    rays = len(origins)
    center, half = BOX.mean(axis=0), 0.5 * (BOX[1] - BOX[0])
    kinds = (wp.vec3, float, float, basis_vector)
    outputs = [wp.empty(rays * PIECES, dtype=kind, device=device) for kind in kinds]
    seed = wp.full(1, seed, dtype=int, device=device)
    wp.launch(
        pieces_kernel,
        dim=(rays, PIECES),
        inputs=[
            *on_device((origins, directions), device),
            *(wp.vec3(*center), wp.vec3(*half), seed, 0),
        ],
        outputs=outputs,
        device=device,
    )

    def by_ray(values):
        front, behind = np.split(values, [rays * FRONT_PIECES])
        shape = values.shape[1:]
        parts = front.reshape(rays, FRONT_PIECES, *shape), behind.reshape(rays, -1, *shape)
        return np.concatenate(parts, axis=1)

    return [by_ray(output.numpy()) for output in outputs[:3]]


def rays_at(targets, rng):
    origins = rng.normal(size=targets.shape)
    origins = 0.5 + 2.5 * origins / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = targets - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_no_piece_lies_in_the_box(device):
    rng = np.random.default_rng()
    origins, directions = rays_at(rng.uniform(*BOX, (200, 3)), rng)
    points, length, t = pieces(origins, directions, device, seed=3)
    assert np.abs(points).max(axis=-1).min() > 1.0 - 1e-4
    assert (np.diff(t, axis=1) > 0.0).all()
    assert (length >= 0.0).all()
    middle, _, t = pieces(origins, directions, device)
    expected = contract(origins[:, None] + t[..., None] * directions[:, None], BOX)
    np.testing.assert_allclose(middle, expected, atol=1e-4)


def test_pieces_reach_from_the_camera_to_far_away(device):
    rng = np.random.default_rng()
    origins, directions = rays_at(rng.uniform(*BOX, (50, 3)), rng)
    _, _, t = pieces(origins, directions, device)
    # The middle of the first of equal pieces; no camera is farther than 3.2 from the box.
    assert t[:, 0].max() < NEAR + 0.5 * 3.2 / FRONT_PIECES
    assert t[:, -1].min() > 10.0


def test_a_ray_that_misses_the_box_has_no_gap(device):
    origins, directions = np.array([[3.0, 0.5, 3.0]]), np.array([[-1.0, 0.0, 0.0]])
    _, _, t = pieces(origins, directions, device)
    assert (np.diff(t, axis=1) > 0.0).all()
    gap = t[0, FRONT_PIECES] - t[0, FRONT_PIECES - 1]
    assert gap < 2.5 * (t[0, 1] - t[0, 0])


def test_a_camera_inside_the_box_sees_what_is_behind(device):
    origins, directions = np.full((1, 3), 0.5), np.array([[0.0, 0.0, 1.0]])
    _, length, t = pieces(origins, directions, device)
    np.testing.assert_allclose(length[0, :FRONT_PIECES], 0.0, atol=1e-6)
    assert t[0, FRONT_PIECES] > 0.2


def test_a_pixel_is_front_over_object_over_behind():
    front = torch.tensor([[0.1, 0.0, 0.0]]), torch.tensor([0.5])
    pixel = over(front, torch.tensor([[0.0, 0.4, 0.0]]), torch.tensor([0.75]), torch.ones(1, 3))
    np.testing.assert_allclose(pixel, [[0.1 + 0.5 * 0.25, 0.5 * 0.65, 0.5 * 0.25]])


def test_an_empty_world_shows_its_sky(device):
    start = random_surroundings(BOX)
    start.density_layers[-1][1][0] = -30.0
    start.sky[:] = (0.2, 0.5, 0.7)
    around = LearnedSurroundings(start, device)
    rng = np.random.default_rng()
    rays = on_device(rays_at(rng.uniform(*BOX, (9, 3)), rng), device)
    (color, opacity), behind = around(*rays, wp.zeros(1, dtype=int, device=device))
    color, opacity, behind = (a.detach().cpu().numpy() for a in (color, opacity, behind))
    np.testing.assert_allclose(opacity, 0.0, atol=1e-6)
    np.testing.assert_allclose(color, 0.0, atol=1e-6)
    np.testing.assert_allclose(behind, np.tile([0.2, 0.5, 0.7], (9, 1)), atol=1e-5)


@pytest.fixture(scope="module")
def trained():
    changes = {"spacing": 0.08, "coarse_steps": 80, "fine_steps": 100, "level_count": 3}
    box = (-0.6, -0.6, -0.6, 0.6, 0.6, 0.6)
    dataset = photographs()
    options = preset("tiny", samples_per_step=2**12, aabb=box, **changes)
    return dataset, trainer.train(dataset, options, "cpu", "ball")


def test_object_and_surroundings_are_learnt_apart(trained):
    """Whole images are matched, and the tets hold what is in the box alone."""
    dataset, result = trained
    whole = evaluate(result.field, dataset)["mean"]["psnr"]
    alone = evaluate(replace(result.field, surroundings=None), dataset)["mean"]["psnr"]
    assert whole > 20.0
    assert alone < 12.0  # the ball on white
    middles = result.field.mesh.rest_vertices[result.field.mesh.tets].mean(axis=1)
    assert middles.min() > -0.1 and middles.max() < 1.1


def test_they_are_stored_if_asked_for(trained, tmp_path):
    _, result = trained
    modelfile.save(result.field, tmp_path / "whole.npz")
    loaded = modelfile.load(tmp_path / "whole.npz").surroundings
    np.testing.assert_array_equal(loaded.box, result.field.surroundings.box)
    table = result.field.surroundings.table
    np.testing.assert_allclose(loaded.table, table, rtol=1e-3, atol=1e-6)
    modelfile.save(replace(result.field, surroundings=None), tmp_path / "object.npz")
    assert modelfile.load(tmp_path / "object.npz").surroundings is None
    sizes = [(tmp_path / name).stat().st_size for name in ("whole.npz", "object.npz")]
    assert sizes[0] > sizes[1] + 2**20
