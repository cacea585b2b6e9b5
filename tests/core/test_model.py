"""A model in a few lines: the object is in the picture, and poses are rendered as Renderer does."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.deform import Material, XpbdSolver, lowest_pins
from deformrf.core.field import load as load_field
from deformrf.core.model import Model, load
from deformrf.core.render import Renderer, camera_rays

EDGE = 1  # pixels: 5 % of a small picture's half


@pytest.fixture
def model(ball, device):
    return Model(ball, device)


@pytest.mark.parametrize("size", [(64, 64), (96, 40), (40, 96)])
@pytest.mark.parametrize("direction", [(0, -1, 0.3), (1, 0, 0), (-2, 3, 1), (0, 0, 5), (0, 0, -1)])
def test_the_camera_sees_all_of_the_object(model, direction, size):
    camera = model.camera(direction, *size)
    opacity = model.render(camera).color_array()[..., 3]
    assert opacity.shape == size[::-1]
    inside = opacity[EDGE:-EDGE, EDGE:-EDGE]
    assert opacity.astype(int).sum() == inside.astype(int).sum()  # nothing at the border
    rows, columns = np.nonzero(inside > 128)
    assert max(np.ptp(rows) / size[1], np.ptp(columns) / size[0]) > 0.5
    _, rays = camera_rays(camera)
    away = np.asarray(direction) / np.linalg.norm(direction)
    np.testing.assert_allclose(
        rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0)), -away, atol=0.02
    )


def test_a_pose_is_rendered_as_by_a_renderer(model, device):
    rest = model.field.mesh.rest_vertices
    bent = (rest + 0.1 * np.sin(4.0 * rest[:, [2, 0, 1]])).astype(np.float32)
    assert np.array_equal(model.vertices, rest.astype(np.float32))
    model.set_vertices(bent)
    assert np.array_equal(model.vertices, bent)
    renderer = Renderer(model.field, device)
    renderer.set_vertices(bent)
    cameras = [model.camera(width=40, height=30), model.camera((1, 1, 0), 20, 20)]
    images = model.render(cameras)
    for image, camera in zip(images, cameras, strict=True):
        assert np.array_equal(image.color_array(), renderer.render(camera).color_array())
    assert np.array_equal(model.render().color_array(), model.render(model.camera()).color_array())
    assert model.render([]) == []


def test_a_solver_has_the_model_s_pins_material_and_stiffness(ball):
    rest, tets = ball.mesh.rest_vertices, ball.mesh.tets
    factors = np.random.default_rng().uniform(0.1, 10.0, len(rest)).astype(np.float32)
    model = Model(replace(ball, stiffness=factors), "cpu")
    solver, expected = model.solver(), XpbdSolver(rest, tets, Material(), lowest_pins(rest, tets))
    expected.set_stiffness(factors)
    free = int(rest[:, 2].argmax())
    for one in (solver, expected):
        one.grab([free])
        one.move([rest[free] + (0.1, 0.0, 0.1)])
        one.step(1 / 60)
    assert np.array_equal(solver.vertices.numpy(), expected.vertices.numpy())
    pins = np.arange(len(rest)) == free
    solver = model.solver(Material(young_modulus=1e4), pinned=pins)
    assert np.array_equal(solver.pinned, pins) and solver.material.young_modulus == 1e4


def test_a_model_is_saved_and_loaded(ball_file, tmp_path):
    model = load(ball_file, device="cpu")
    model.save(tmp_path / "copy.npz")
    assert np.array_equal(load_field(tmp_path / "copy.npz").table, model.field.table)
    assert load(tmp_path / "copy.npz").device in ("cpu", "cuda:0")


@pytest.mark.parametrize(
    "wrong, sentence",
    [
        (lambda m: load("fox", "gpu"), 'no device "gpu"'),
        (lambda m: m.camera(direction=(0, 0, 0)), "it has no length"),
        (lambda m: m.set_vertices(np.full_like(m.vertices, np.nan)), "no finite numbers"),
    ],
)
def test_what_can_not_be_is_said_at_once(model, wrong, sentence):
    with pytest.raises(ValueError, match=sentence):
        wrong(model)


def test_a_bundled_model_is_loaded_by_its_name():
    assert "fox" in load("fox").field.attribution.lower()
    assert repr(load(device="cpu")) == "Model(5416 tets, 1632 vertices, on cpu)"
