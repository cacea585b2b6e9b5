"""Tangled rays on a CPU: windows from front to back give the defined image, and end early."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import warp as wp
from fold_poses import crowd, denser, folded, from_inside

from deformrf.core.definition.image import render_rays
from deformrf.core.render import Renderer, RenderOptions, camera_rays
from deformrf.core.render.overlap import windows
from deformrf.core.render.overlap.merging import PieceMerger


@pytest.fixture(params=[False, True], ids=["color a sample", "color a ray"])
def make_ball_field(request, make_ball_field):
    return partial(make_ball_field, deferred=request.param)


EXACT = RenderOptions(conformance=True, details=True)


@pytest.mark.parametrize("factor", [-3.0, 0.0, 4.0])
def test_a_camera_inside_a_fold_sees_the_defined_image(factor, make_ball_field):
    field = denser(make_ball_field(3, occupied_share=1.0, march_step=0.004), factor)
    vertices = folded(field)
    renderer = Renderer(field, "cpu")
    renderer.set_vertices(vertices)
    origins, directions = camera_rays(from_inside(vertices))
    expected, opacity, _ = render_rays(field.definition, vertices, origins, directions, (1, 1, 1))
    found, seen, _ = renderer.render_rays(origins, directions, EXACT)
    off = 255.0 * np.abs(found - expected).max(axis=1)
    assert off.mean() <= 0.3 and (off > 2.0).mean() <= 0.02
    assert np.abs(seen - opacity).max() <= 2e-3


def test_an_opaque_fold_is_not_shaded_to_its_end(make_ball_field):
    thin = make_ball_field(3, occupied_share=1.0, march_step=0.004)
    counts = []
    for field in (denser(thin, -20.0), denser(thin, 4.0)):
        renderer = Renderer(field, "cpu")
        vertices = folded(field)
        renderer.set_vertices(vertices)
        counts.append(renderer.render(from_inside(vertices), EXACT).sample_count)
    assert counts[1] < 0.4 * counts[0]


def test_windows_of_any_length_give_the_same_pixels(make_ball_field, monkeypatch):
    field = make_ball_field(5, march_step=0.004)
    vertices = folded(field)
    images = []
    for steps in (0.7, 8.0, 1e4):
        monkeypatch.setattr(windows, "FIRST_STEPS", steps)
        renderer = Renderer(field, "cpu")
        renderer.set_vertices(vertices)
        origins, directions = camera_rays(from_inside(vertices))
        images.append(renderer.render_rays(origins, directions, replace(EXACT, termination=0.0)))
    for image in images[1:]:
        for found, expected in zip(image, images[0], strict=True):
            np.testing.assert_allclose(found, expected, atol=2e-4)


def test_a_crowded_place_is_merged_as_a_whole(make_ball_field, monkeypatch):
    field = denser(make_ball_field(7, spacing=0.04, march_step=0.02), -5.0)
    vertices, camera = crowd(field)
    renderer = Renderer(field, "cpu")
    renderer.set_vertices(vertices)
    origins, directions = camera_rays(camera)
    expected, _, _ = render_rays(field.definition, vertices, origins, directions, (1, 1, 1))
    crowded, render_some = [], PieceMerger._render_some
    monkeypatch.setattr(
        PieceMerger,
        "_render_some",
        lambda self, rays, ids, *others: (
            crowded.append(len(ids)) or render_some(self, rays, ids, *others)
        ),
    )
    found, _, _ = renderer.render_rays(origins, directions, EXACT)
    assert sum(crowded) >= 4
    off = 255.0 * np.abs(found - expected).max(axis=1)
    assert off.mean() <= 0.3 and (off > 2.0).mean() <= 0.02


def test_infinite_vertices_end_no_render_in_a_loop(make_ball_field):
    field = make_ball_field(8)
    vertices = folded(field)
    vertices[3] = np.inf
    renderer = Renderer(field, "cpu")
    renderer.set_vertices(wp.array(vertices, dtype=wp.vec3, device="cpu"))
    renderer.render(from_inside(folded(field), 4))
