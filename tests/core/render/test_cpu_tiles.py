"""Tiles on a CPU: a thread's memory brings nothing from one image into another."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.render import Renderer, RenderOptions, from_field_of_view, look_at


def random_camera(rng):
    """Near, inside, far, or with parallel rays, of some size."""
    direction = rng.normal(size=3)
    distance = float(rng.choice([0.05, 1.4, 2.0, 40.0]))
    eye = 0.5 + distance * direction / np.linalg.norm(direction)
    width, height = rng.integers(1, 60, 2).tolist()
    camera = from_field_of_view(
        look_at(eye, (0.5, 0.5, 0.5)), 0.9 / max(distance, 1), width, height
    )
    if rng.random() < 0.3:
        lens = replace(camera.lens, focal=(40.0, 35.0))
        camera = replace(camera, parallel=True, lens=lens)
    return camera


def random_options(rng):
    background = tuple(rng.random(3).tolist())
    return RenderOptions(
        background=background,
        details=bool(rng.random() < 0.5),
        conformance=bool(rng.random() < 0.3),
        level_count=int(rng.integers(1, 3)) if rng.random() < 0.3 else None,
    )


@pytest.mark.parametrize("deferred", [False, True])
def test_an_image_after_others_is_that_of_a_new_renderer(make_ball_field, deferred):
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(100)), deferred=deferred)
    rest, used = field.mesh.rest_vertices, Renderer(field)
    for _ in range(12):
        vertices = rest + float(rng.choice([0.0, 0.02, 0.4])) * rng.normal(size=3) * np.sin(
            9 * rest
        )
        camera, options = random_camera(rng), random_options(rng)
        new = Renderer(field)
        images = []
        for renderer in (used, new):
            renderer.set_vertices(vertices)
            images.append(renderer.render(camera, options))
        for one in ("color", "depth") + ("tet", "samples") * options.details:
            arrays = [getattr(image, one).numpy() for image in images]
            np.testing.assert_array_equal(*arrays)
        assert images[0].sample_count == images[1].sample_count


def test_a_strip_without_rows_and_a_background_in_an_array(make_ball_field):
    renderer = Renderer(make_ball_field(3))
    camera = from_field_of_view(look_at((2.0, 0.5, 0.5), (0.5, 0.5, 0.5)), 0.8, 16, 12)
    assert renderer.render(camera, rows=(5, 5)).color.shape == (0, 16)
    for color in ((1.0, 0.0, 0.0), (1.0, 1.0, 0.0)):
        image = renderer.render(camera, RenderOptions(background=np.array(color)))
        np.testing.assert_array_equal(image.color_array()[0, 0, :3], 255 * np.array(color))
