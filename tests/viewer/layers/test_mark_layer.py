"""Marks in their colors, where they are told."""

import numpy as np
import pytest

from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.camera import picking
from deformrf.viewer.document import Scene
from deformrf.viewer.layers import Canvas, MarkLayer
from deformrf.viewer.layers.handle_layer import far_first, sphere_rows

SIZE = 400, 300
BLUE, ORANGE = (0.10, 0.55, 0.95), (0.95, 0.45, 0.10)


def test_marks_have_their_colors_and_far_ones_come_first():
    rng = np.random.default_rng()
    places, tints = rng.normal(size=(40, 3)), rng.random((40, 3))
    rows = sphere_rows(places, 0.1, tints)
    instances = far_first(rows, places, np.array([0.0, -9.0, 0.0]))
    away = np.linalg.norm(instances[:, :3] - [0.0, -9.0, 0.0], axis=1)
    assert (np.diff(away) <= 1e-6).all()
    np.testing.assert_allclose(instances[:, 3], 0.1)
    order = np.argsort(-np.linalg.norm(places - [0.0, -9.0, 0.0], axis=1))
    np.testing.assert_allclose(instances[:, 4:], tints[order], rtol=1e-6)


@pytest.mark.gl
def test_marks_show_where_they_are(ball, window):
    scene, context = Scene(ball, "ball", "cpu"), window[1]
    camera, clips = (
        f(scene.orbit) for f in (lambda o: orbits.camera_of(o, *SIZE), orbits.clip_range)
    )
    places = scene.center + np.array([[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0]])
    canvas, layer = Canvas(context), MarkLayer(context)
    canvas.use(SIZE)
    context.clear(0, 0, 0, 1, depth=1.0)
    layer.draw_marks(camera, clips, (places, np.array([BLUE, ORANGE]), 0.02))
    image = canvas.read().astype(int)
    (blue, orange), _ = picking.project(camera, places)
    r, _, b = image[int(blue[1]), int(blue[0])][:3]
    assert b > r + 40
    r, _, b = image[int(orange[1]), int(orange[0])][:3]
    assert r > b + 40
    layer.release()
