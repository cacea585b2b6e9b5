"""Tangled rays of a wavefront: windows from front to back give the defined image."""

from functools import partial

import numpy as np
import pytest
import warp as wp
from fold_poses import crowd, denser, folded, from_inside
from slot_rendering import assert_alike, in_slots

from deformrf.core.definition.image import render_rays
from deformrf.core.render import (
    Renderer,
    RenderOptions,
    camera_rays,
    from_field_of_view,
    look_at,
)
from deformrf.core.render.overlap import window_slots
from deformrf.core.render.overlap.merging import PieceMerger
from deformrf.core.render.rounds import wavefront


@pytest.fixture(params=[False, True], ids=["color a sample", "color a ray"])
def make_ball_field(request, make_ball_field):
    return partial(make_ball_field, deferred=request.param)


BACKGROUND = (0.2, 0.5, 0.9)
OPTIONS = RenderOptions(BACKGROUND)
TO_THE_END = RenderOptions(BACKGROUND, termination=0.0)


def prepared(field, vertices, device):
    renderer = in_slots(Renderer(field, device))
    renderer.set_vertices(vertices)
    return renderer


def in_wavefront(renderer, camera):
    """Its image by the wavefront, to the end of each ray, and how many were merged as a whole."""
    merged, render_some = [], PieceMerger._render_some

    def counted(self, rays, ids, *others):
        merged.append(len(ids))
        return render_some(self, rays, ids, *others)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PieceMerger, "_render_some", counted)
        return renderer.render(camera, TO_THE_END), sum(merged)


def assert_is_defined(image, field, vertices, camera):
    origins, directions = camera_rays(camera)
    expected, _, _ = render_rays(field.definition, vertices, origins, directions, BACKGROUND)
    found = image.color_array().reshape(-1, 4)[:, :3]
    off = np.abs(found - 255.0 * expected).max(axis=1)
    assert off.mean() <= 0.8 and (off > 4.0).mean() <= 0.02


@pytest.mark.parametrize("factor", [pytest.param(-3.0, marks=pytest.mark.soak), 0.0, 4.0])
def test_a_camera_inside_a_fold_sees_the_defined_image(factor, make_ball_field, device):
    field = denser(make_ball_field(3, occupied_share=1.0, march_step=0.004), factor)
    vertices = folded(field)
    renderer = prepared(field, vertices, device)
    camera = from_inside(vertices)
    image, merged = in_wavefront(renderer, camera)
    assert_is_defined(image, field, vertices, camera)
    assert merged == 0


def test_an_opaque_fold_is_not_evaluated_to_its_end(make_ball_field, device):
    thin = make_ball_field(3, occupied_share=1.0, march_step=0.004)
    counts = []
    for field in (denser(thin, -20.0), denser(thin, 4.0)):
        vertices = folded(field)
        counts.append(
            prepared(field, vertices, device).render(from_inside(vertices), OPTIONS).sample_count
        )
    assert counts[1] < 0.5 * counts[0]


@pytest.mark.parametrize("least", [4, 32])
def test_few_or_many_slots_and_little_room_give_the_same_image(
    make_ball_field, device, monkeypatch, least
):
    """Also if a round has room for some of the rays only."""
    field = make_ball_field(5, march_step=0.004)
    vertices = folded(field)
    camera = from_inside(vertices, 40)
    expected = prepared(field, vertices, device).render(camera, OPTIONS)
    monkeypatch.setattr(window_slots, "LEAST_SLOTS", least)
    monkeypatch.setattr(wavefront, "SLOTS_PER_PIXEL", 0.2)
    monkeypatch.setattr(wavefront, "LEAST_SLOTS_IN_ALL", 0)
    assert_alike(prepared(field, vertices, device).render(camera, OPTIONS), expected)


@pytest.mark.parametrize("size", [(1, 33), (33, 1), (1, 1), (70, 9)])
@pytest.mark.parametrize("spacing", [0.24, 0.1])
def test_any_size_of_images_and_meshes(make_ball_field, device, size, spacing):
    """Bins and words of bits that are not full; and strips of an image are parts of it."""
    field = denser(make_ball_field(9, spacing=spacing, march_step=0.02), 2.0)
    vertices = folded(field)
    camera = from_inside(vertices, 8)
    camera = camera.resized(*size)
    renderer = prepared(field, vertices, device)
    image = renderer.render(camera, OPTIONS)
    merged = Renderer(field, device)
    merged.set_vertices(vertices)
    # NumPy's networks, which stand for tensor cores on a CPU, don't round as bfloat16 does.
    options = RenderOptions(BACKGROUND, path="merge", single_precision=device == "cpu")
    assert_alike(image, merged.render(camera, options))
    if size[1] > 1:
        middle = size[1] // 2
        parts = [
            renderer.render(camera, OPTIONS, rows) for rows in ((0, middle), (middle, size[1]))
        ]
        parts = np.concatenate([part.color_array() for part in parts])
        assert np.abs(parts.astype(int) - image.color_array()).max() <= 2


def test_crowded_rays_are_merged_as_a_whole(make_ball_field, device):
    field = denser(make_ball_field(7, spacing=0.04, march_step=0.02), -5.0)
    vertices, camera = crowd(field)
    image, merged = in_wavefront(prepared(field, vertices, device), camera)
    assert merged >= 4
    assert_is_defined(image, field, vertices, camera)


def test_poses_one_after_another(make_ball_field, device):
    """Each has the image of a new renderer, where an overlap ends or begins as well."""
    field = make_ball_field(6, march_step=0.01)
    rest, end = field.mesh.rest_vertices, folded(field)
    renderer = prepared(field, end, device)
    camera = from_inside(end, 30)
    for share in (1.0, 0.8, 0.95, 0.0, 0.0, 0.9, 0.0):
        vertices = (rest + share * (end - rest)).astype(np.float32)
        renderer.set_vertices(vertices)
        found = renderer.render(camera, OPTIONS)
        expected = prepared(field, vertices, device).render(camera, OPTIONS)
        assert_alike(found, expected)
        # Where an overlap ends, plain rays are among windows once more, and fill slots behind
        # their ends.
        assert 0.98 < found.sample_count / expected.sample_count < (1.02 if share > 0.0 else 1.3)
        assert renderer.overlap.expected == (share > 0.0)


def test_tets_beyond_the_boundary_are_seen(make_ball_field, device):
    """A vertex from inside is pulled out: rays meet tets, half of them inverted, but no face."""
    field = denser(make_ball_field(4, occupied_share=1.0, march_step=0.01), 4.0)
    vertices = field.mesh.rest_vertices.astype(np.float32)
    middle = vertices.mean(axis=0)
    vertices[np.linalg.norm(vertices - middle, axis=1).argmin()] += (0.6, 0.0, 0.0)
    at = middle + np.float32([0.4, 0.0, 0.0])
    camera = from_field_of_view(look_at(at - np.float32([0.0, 1.2, 0.0]), at), 0.3, 16, 16)
    renderer = prepared(field, vertices, device)
    image, _ = in_wavefront(renderer, camera)
    assert_is_defined(image, field, vertices, camera)
    seen = image.color_array().reshape(-1, 4)[:, 3] > 128
    assert (seen & (renderer._wavefront.buffers.rays.entries.count.numpy()[: len(seen)] == 0)).any()


def test_each_launch_has_the_block_size_that_its_module_is_compiled_for(
    make_ball_field, device, monkeypatch
):
    """Another one would compile the module again, in the middle of a drag."""
    field = make_ball_field(6, march_step=0.01)
    vertices, launch, sizes = folded(field), wp.launch, {}

    def noted(kernel, *arguments, block_dim=256, **named):
        sizes.setdefault(kernel.module.name, set()).add(block_dim)
        return launch(kernel, *arguments, block_dim=block_dim, **named)

    renderer = prepared(field, vertices, device)
    monkeypatch.setattr(wp, "launch", noted)
    renderer.render(from_inside(vertices), OPTIONS)
    assert window_slots.__name__ in sizes
    for name, used in sizes.items():
        assert used == {wp.get_module(name).options["block_dim"]}, name


def test_infinite_vertices_end_no_render_in_a_loop(make_ball_field, device):
    field = make_ball_field(8)
    vertices = folded(field)
    vertices[3] = np.inf
    renderer = in_slots(Renderer(field, device))
    renderer.set_vertices(wp.array(vertices, dtype=wp.vec3, device=device))
    renderer.render(from_inside(folded(field), 4), OPTIONS)
