"""The wavefront makes the image that the rounds of the host make."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import warp as wp
from slot_rendering import assert_alike, in_slots

from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.core.base.wide import vec4h
from deformrf.core.field import modelfile, node_table
from deformrf.core.render import (
    Camera,
    Lens,
    Renderer,
    RenderOptions,
    device_camera,
    empty_samples,
    from_field_of_view,
    look_at,
)
from deformrf.core.render.rays.entries import UNKNOWN
from deformrf.core.render.rounds import slots, tracing, wavefront


@pytest.fixture(params=[False, True], ids=["color a sample", "color a ray"])
def make_ball_field(request, make_ball_field):
    return partial(make_ball_field, deferred=request.param)


BACKGROUND = (0.2, 0.5, 0.9)
HOST_ROUNDS = RenderOptions(BACKGROUND, path="host")


def view(width=50, height=37):
    rng = np.random.default_rng()
    direction = rng.normal(size=3) * [1.0, 1.0, 0.5]
    eye = 0.5 + 1.4 * direction / np.linalg.norm(direction)
    return from_field_of_view(look_at(eye, (0.5, 0.5, 0.5)), 0.6, width, height)


@pytest.mark.parametrize("slots_per_pixel", [wavefront.SLOTS_PER_PIXEL, 0.1])
def test_both_paths_make_the_same_image(make_ball_field, device, monkeypatch, slots_per_pixel):
    """Also if a round has room for some of the rays only."""
    monkeypatch.setattr(wavefront, "SLOTS_PER_PIXEL", slots_per_pixel)
    monkeypatch.setattr(wavefront, "LEAST_SLOTS_IN_ALL", 0)
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(1000)))
    renderer, rest = in_slots(Renderer(field, device)), field.mesh.rest_vertices
    for _ in range(6):  # the second time it knows how many rounds it takes; then it has a graph
        renderer.set_vertices(rest @ (np.eye(3) + rng.uniform(-0.1, 0.1, (3, 3))))
        camera, background = view(150, 120), tuple(rng.uniform(size=3))
        assert_alike(
            renderer.render(camera, RenderOptions(background)),
            renderer.render(camera, RenderOptions(background, path="host")),
        )


@pytest.mark.parametrize("inside", [False, True])
def test_more_rays_than_threads_make_the_same_image(make_ball_field, device, monkeypatch, inside):
    """Threads take other rays when theirs have ended; from inside all of them search."""
    monkeypatch.setattr(tracing, "BLOCKS_PER_PROCESSOR", 1)
    monkeypatch.setattr(tracing, "SEARCH_BLOCKS", 1)
    renderer = in_slots(Renderer(make_ball_field(3), device))
    size = 400 if renderer.device.is_cuda else 40
    camera = view(size, size)
    if inside:
        camera = from_field_of_view(look_at((0.52, 0.47, 0.5), (0.9, 0.4, 0.5)), 1.2, size, size)
    assert_alike(
        renderer.render(camera, RenderOptions(BACKGROUND)), renderer.render(camera, HOST_ROUNDS)
    )


@pytest.mark.parametrize("eye", [(1.4, 0.3, 0.9), (0.52, 0.48, 0.5)])
def test_traced_rays_have_the_samples_of_the_rounds(eye):
    """On a CPU, where nothing is dense for `trace`, so that rays end at the last sample."""
    renderer = Renderer(modelfile.load(DEFAULT_MODEL), "cpu")
    camera = from_field_of_view(look_at(eye, (0.5, 0.5, 0.5)), 0.6, 24, 24)
    field, every = renderer.field, RenderOptions(termination=0.0, path="host", details=True)
    room = wavefront.Wavefront(renderer.pose, renderer.shading, field.options, 24 * 24)
    room._traces = True
    room.begin(device_camera(camera), (0, 24), every, renderer.stage)
    lists = room.buffers.state.numpy()[[slots.NEXT_LISTED, slots.SEARCHING]]
    thread_count = 128
    own = empty_samples(thread_count * int(tracing.SLOTS), "cpu")
    empty = [wp.zeros(1, dtype=vec4h, device="cpu"), wp.zeros(1, dtype=float, device="cpu")]
    inputs = [renderer.pose.geometry, renderer.shading.tables, empty[0], empty[0], 0, *empty]
    inputs += [0.5, own, thread_count, room.buffers]
    for kernel in (tracing.trace_kernel, tracing.trace_searching_kernel):
        wp.launch(kernel, thread_count, inputs, device="cpu", block_dim=slots.BLOCK_SIZE)
    state = room.buffers.state.numpy()
    assert lists.max() > thread_count  # threads take rays again and again
    assert state[slots.SAMPLES] == renderer.render(camera, every).sample_count > 1000
    assert (state[[slots.NEXT_RAY, slots.NEXT_SEARCHING]] >= lists).all()


def test_what_rounds_need_is_allocated_for_the_first_fold(make_ball_field, device):
    field = make_ball_field(6)
    renderer = in_slots(Renderer(field, device))
    camera, rest = view(), field.mesh.rest_vertices
    renderer.render(camera)
    if field.options.deferred and renderer.device.is_cuda:
        assert not renderer._wavefront.buffers.sigma
    folded = rest.copy()
    folded[0] += 1.0
    renderer.set_vertices(folded)
    # merging.py ends no ray early, and what is left of the light goes far: depths would differ.
    options = RenderOptions(termination=1e-4)
    by_host = replace(options, path="host")
    for _ in range(2):  # the second time it is expected
        assert_alike(renderer.render(camera, options), renderer.render(camera, by_host))
    assert len(renderer._wavefront.buffers.sigma)
    renderer.set_vertices(rest)
    assert_alike(renderer.render(camera, options), renderer.render(camera, by_host))


def test_timed_stages_make_the_same_image(make_ball_field, device):
    renderer = in_slots(Renderer(make_ball_field(1), device))
    camera = view()
    image = renderer.render(camera).color_array()
    renderer.stage.seconds = {}
    np.testing.assert_array_equal(renderer.render(camera).color_array(), image)
    assert {"begin", "networks"} <= set(renderer.stage.seconds)


def test_rays_that_search_for_their_entries_are_seen(make_ball_field, device):
    """Those that begin inside of the mesh: a kernel of their own lets them march."""
    renderer = in_slots(Renderer(make_ball_field(5), device))
    eye = 0.5 + np.random.default_rng().uniform(-0.05, 0.05, 3)
    camera = from_field_of_view(look_at(eye, (0.9, 0.4, 0.5)), 1.2, 60, 50)
    image = renderer.render(camera, RenderOptions(BACKGROUND))
    assert (renderer._wavefront.buffers.rays.entries.count.numpy()[: 60 * 50] == UNKNOWN).all()
    assert image.sample_count > 1000
    assert_alike(image, renderer.render(camera, HOST_ROUNDS))


def test_rays_that_meet_an_edge_of_the_boundary_search(make_ball_field, device):
    """A walk through the tets may see them on its other side, and leave the mesh for good."""
    rng = np.random.default_rng()
    renderer = in_slots(Renderer(make_ball_field(5), device))
    geometry = renderer.pose.geometry
    vertices, faces = geometry.vertices.numpy(), geometry.faces.numpy()
    searching = 0
    for face in rng.choice(faces, 40):
        share = rng.uniform(0.1, 0.9)
        at = share * vertices[face[0]] + (1.0 - share) * vertices[face[1]]
        away = rng.normal(size=3)
        eye = at + 1.4 * away / np.linalg.norm(away)
        renderer.render(from_field_of_view(look_at(eye, at), 0.1, 1, 1))
        searching += renderer._wavefront.buffers.rays.entries.count.numpy()[0] == UNKNOWN
    assert searching >= 36  # others passed beside it, by a rounding
    renderer.render(view(80, 60))
    count = renderer._wavefront.buffers.rays.entries.count.numpy()[: 80 * 60]
    assert (count == UNKNOWN).sum() <= 0.02 * (count != 0).sum()


def test_the_path_host_and_details_use_no_wavefront(make_ball_field, device):
    renderer = in_slots(Renderer(make_ball_field(4), device))
    for options in (RenderOptions(path="host"), RenderOptions(details=True)):
        renderer.render(view(), options)
        assert renderer._wavefront is None


def test_strips_and_smaller_images_use_the_same_buffers(make_ball_field, device):
    renderer = in_slots(Renderer(make_ball_field(2), device))
    camera = view()
    whole = renderer.render(camera).color_array()
    room = renderer._wavefront
    strips = [renderer.render(camera, rows=rows).color_array() for rows in ((0, 5), (5, 37))]
    np.testing.assert_array_equal(np.concatenate(strips), whole)
    assert renderer.render(camera.resized(20, 10)).color_array().shape == (10, 20, 4)
    assert renderer._wavefront is room
    assert renderer.render(camera.resized(60, 50)).color_array().shape == (50, 60, 4)


def test_another_background_needs_no_new_graphs(make_ball_field, device):
    renderer = in_slots(Renderer(make_ball_field(3), device))
    camera = view()
    renderer.render(camera)
    dark = RenderOptions(background=(0.0, 0.0, 0.0))
    assert_alike(
        renderer.render(camera, dark),
        renderer.render(camera, RenderOptions((0, 0, 0), path="host")),
    )


def test_tangled_rays_see_every_tet(make_ball_field, device):
    """A part of the image sees overlap."""
    field = make_ball_field(int(np.random.default_rng().integers(1000)), occupied_share=1.0)
    renderer = in_slots(Renderer(field, device))
    camera = view()
    plain = renderer.render(camera, RenderOptions(BACKGROUND))
    kept = plain.color_array().copy()
    vertices = field.mesh.rest_vertices.copy()
    vertices[np.argmax(vertices @ camera.camera_to_world[:3, 2])] += 0.25 * camera.forward
    renderer.set_vertices(vertices)
    # On CUDA the host merges a ray to its far end, and rounds stop where it is opaque.
    whole = {"termination": 1e-4}
    mended = renderer.render(camera, RenderOptions(BACKGROUND, **whole))
    assert_alike(mended, renderer.render(camera, replace(HOST_ROUNDS, **whole)))
    rays = renderer._wavefront.buffers.rays
    ids = wp.array(np.arange(camera.width * camera.height), dtype=int, device=renderer.device)
    _, tangled = renderer.overlap.sort_rays(rays, ids)
    assert 0 < len(tangled) < 0.5 * (mended.color_array()[..., 3] > 0).sum()
    np.testing.assert_array_equal(plain.color_array(), kept)  # earlier images stay what they are


def test_each_step_has_its_own_graph(make_ball_field, device):
    renderer = in_slots(Renderer(make_ball_field(7), device))
    camera = view()
    images = [renderer.render(camera, RenderOptions(step_factor=f)) for f in (1.0, 0.5, 1.0)]
    assert images[1].sample_count > 1.1 * images[0].sample_count
    np.testing.assert_array_equal(images[2].color_array(), images[0].color_array())


def test_features_of_unused_levels_are_zero(make_ball_field, device):
    """Slots, or shared memory, still hold the features of the last image."""
    renderer = in_slots(
        Renderer(make_ball_field(int(np.random.default_rng().integers(1000))), device)
    )
    camera, level_count = view(), renderer.field.layout.level_count
    whole = renderer.render(camera).color_array()
    for count in range(1, level_count + 1):
        found = renderer.render(camera, RenderOptions(level_count=count))
        expected = renderer.render(camera, RenderOptions(level_count=count, path="host"))
        assert_alike(found, expected)
        same = (found.color_array() == whole).all()
        assert same == (count == level_count)
    np.testing.assert_array_equal(renderer.render(camera).color_array(), whole)


def test_a_real_lens_in_strips(make_ball_field, device):
    renderer = in_slots(Renderer(make_ball_field(8), device))
    pose = view().camera_to_world
    lens = Lens(60, 45, (80.0, 82.0), (28.0, 24.0), (0.1, -0.05, 0.0, 0.0), (0.01, -0.02))
    camera = Camera(pose, lens)
    strips = [renderer.render(camera, rows=rows).color_array() for rows in ((0, 13), (13, 45))]
    expected = renderer.render(camera, RenderOptions(path="host")).color_array()
    assert np.abs(np.concatenate(strips).astype(int) - expected).mean() < 0.3


def test_without_view_dependence_the_basis_is_constant(make_ball_field, device):
    field = make_ball_field(5, view_dependence=False)
    renderer = in_slots(Renderer(field, device))
    camera = view()
    assert_alike(
        renderer.render(camera, RenderOptions(BACKGROUND)), renderer.render(camera, HOST_ROUNDS)
    )


def test_networks_of_another_shape_make_the_same_image(make_ball_field, device):
    """Three hidden layers for density: torch evaluates them on CUDA, in rounds of the host."""
    field = make_ball_field(9, density_hidden=(64, 64, 64))
    plain = Renderer(field, device)
    assert plain.shading.in_place is None
    camera = view()
    expected = plain.render(camera, HOST_ROUNDS)
    assert_alike(plain.render(camera, RenderOptions(BACKGROUND)), expected)
    if not plain.device.is_cuda:
        assert_alike(in_slots(plain).render(camera, RenderOptions(BACKGROUND)), expected)


def test_nodes_hold_what_entries_hold(make_ball_field):
    field = make_ball_field(6)
    nodes = node_table(field.layout, field.table)
    assert len(nodes) == 1 + sum(ids.size for ids in field.layout.node_ids)
    first = field.layout.node_ids[0]
    np.testing.assert_array_equal(nodes[: first.size], field.table[first.ravel()])


def test_half_entries_are_read_and_written_whole(device):
    from deformrf.core.base.wide import load_wide_half, store_wide_half

    @wp.kernel
    def twice(values: wp.array(dtype=vec4h), result: wp.array(dtype=vec4h)):
        i = wp.tid()
        store_wide_half(result, i, 2.0 * load_wide_half(values, i))

    values = np.random.default_rng().normal(size=(33, 4)).astype(np.float16)
    result = wp.zeros(33, dtype=vec4h, device=device)
    inputs = [wp.array(values, dtype=vec4h, device=device)]
    wp.launch(twice, 33, inputs=inputs, outputs=[result], device=device)
    np.testing.assert_array_equal(result.numpy(), 2 * values)


def test_rays_have_slots_that_exist(device):
    """Also if many rays were stuck with any number of slots before."""
    rng = np.random.default_rng(8)
    room = 16 * wavefront.SLOT_MULTIPLE
    for _ in range(200):
        least, most = 4, 32
        state = np.zeros(slots.STATE_SIZE, np.int32)
        listed = state[slots.NEXT_LISTED] = rng.integers(0, 2 * room // least)
        state[slots.PER_RAY] = before = rng.integers(least, most + 1)
        state[slots.TAKEN], state[slots.STUCK] = 1000, rng.choice([0, 5, 600])
        after = wp.array(state, device=device)
        wp.launch(slots.advance_kernel, 1, [room, least, most, after], device=device)
        after = after.numpy()
        taken, stride, per_ray = after[[slots.TAKEN, slots.STRIDE, slots.PER_RAY]]
        assert taken == listed or 0 < taken < listed
        assert taken <= stride and stride * per_ray == after[slots.TOTAL] <= room
        assert least <= per_ray <= most
        if state[slots.STUCK] == 600:  # the ones that were stuck get more
            assert per_ray >= min(2 * before, most)
