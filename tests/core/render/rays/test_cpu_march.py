"""The march in vectors: slots and states are those of `march_ray`, ray by ray."""

import numpy as np
import pytest
import warp as wp
from tile_rays import begun

from deformrf.core.definition.image import ray_pieces, render_rays
from deformrf.core.definition.subdivision import child_path
from deformrf.core.field import SUBTET_COUNT
from deformrf.core.render import (
    Renderer,
    RenderOptions,
    camera_rays,
    empty_samples,
    from_field_of_view,
    look_at,
)
from deformrf.core.render.rays.cpu_march import ORDERS, SIDE, lattice_paths
from deformrf.core.render.rays.entries import Entries
from deformrf.core.render.rays.marching import MIDDLE, march_kernel
from deformrf.core.render.rounds.compositing import empty_pixels

MANY = 300  # slots: more than any ray needs


def test_paths_are_those_of_points_in_each_cube_and_order():
    bary = np.random.default_rng().dirichlet(np.ones(4), 20_000)
    x = SIDE * bary[:, :0:-1].cumsum(axis=1)[:, ::-1]
    cell = np.minimum(x.astype(int), SIDE - 1)
    f = x - cell
    order = (f[:, 0] >= f[:, 1]) + 2 * (f[:, 0] >= f[:, 2]) + 4 * (f[:, 1] >= f[:, 2])
    place = (cell @ [1, SIDE, SIDE * SIDE]) * ORDERS + order
    np.testing.assert_array_equal(lattice_paths()[place], child_path(bary, levels=2))
    assert len(set(lattice_paths())) == SUBTET_COUNT


def sampled(slots, counts, slot_count):
    """tet, bary, length and t of each ray's samples, with the coordinates side by side."""
    filled = np.arange(slot_count) < counts[:, None]
    columns = [
        getattr(slots, name).numpy().reshape(*filled.shape, -1)[filled]
        for name in ("tet", "bary", "length", "t")
    ]
    return np.split(np.concatenate(columns, axis=1), counts.cumsum()[:-1])


def by_ray(renderer, camera):
    """All samples of each ray, by march_ray in one round."""
    rays, ids = begun(camera, renderer.pose)
    slots = empty_samples(len(ids) * MANY, "cpu")
    counts = wp.empty(len(ids), dtype=int, device="cpu")
    alive = wp.array(ids, dtype=int, device="cpu")
    inputs = [renderer.pose.geometry, rays, alive, MANY, MIDDLE]
    wp.launch(march_kernel, len(ids), inputs, [slots, counts], device="cpu")
    assert (rays.tet.numpy()[ids] == -2).all() and counts.numpy().max() < MANY
    return sampled(slots, counts.numpy(), MANY)


def in_vectors(renderer, camera, options, slot_count):
    """All samples of each ray from rounds of the march in vectors, and how many rounds there were.

    Transmittance stays 1, so that each round goes as far as a ray that begins.
    """
    rays, ids = begun(camera, renderer.pose)
    pixels = empty_pixels(len(rays.t), "cpu")
    found, left, rounds = {ray: [] for ray in ids}, ids, 0
    while len(left):
        alive = wp.array(left, dtype=int, device="cpu")
        march = renderer.host_rounds._on_cpu.march
        slots, counts = march(rays, alive, slot_count, pixels, options)
        assert counts.numpy().min() >= 0 and counts.numpy().max() <= slot_count
        for ray, rows in zip(left, sampled(slots, counts.numpy(), slot_count), strict=True):
            found[ray].append(rows)
        left = left[rays.tet.numpy()[left] > -2]
        rounds += 1
    return [np.concatenate(rows) for rows in found.values()], rounds


@pytest.mark.parametrize("slot_count", [1, 7, MANY])
@pytest.mark.parametrize("bend", [0.0, 0.003])
@pytest.mark.parametrize("termination", [0.03, 0.0])
def test_samples_are_those_of_march_ray(make_ball_field, slot_count, bend, termination):
    rng = np.random.default_rng()
    renderer = Renderer(make_ball_field(int(rng.integers(1000)), gap=0.05), "cpu")
    rest = renderer.field.mesh.rest_vertices
    renderer.set_vertices(rest + bend * rng.normal(size=rest.shape))
    eye = rng.normal(size=3)
    pose = look_at(0.5 + 1.6 * eye / np.linalg.norm(eye), (0.5, 0.5, 0.5))
    camera = from_field_of_view(pose, 0.5, 45, 37)
    expected = by_ray(renderer, camera)
    options = RenderOptions(termination=termination)
    found, rounds = in_vectors(renderer, camera, options, slot_count)
    assert len(expected) == len(found) > 300
    # A middle on the face of a sub-tet or of a tet is on either side, by a rounding.
    same = [
        one.shape == other.shape and np.allclose(one, other, atol=2e-5)
        for one, other in zip(expected, found, strict=True)
    ]
    assert np.mean(same) > 0.99
    total = sum(map(len, expected))
    assert sum(map(len, found)) == pytest.approx(total, rel=2e-3) and total > 3000
    if slot_count == MANY:
        assert (rounds == 1) == (termination == 0.0), "the expected depth ends rounds early"


def test_middles_are_where_the_reference_has_them(make_ball_field):
    rng = np.random.default_rng()
    renderer = Renderer(make_ball_field(int(rng.integers(1000))), "cpu")
    field, rest = renderer.field, renderer.field.mesh.rest_vertices.astype(np.float32)
    renderer.set_vertices(rest)
    camera = from_field_of_view(look_at((1.7, -0.7, 1.0), (0.5, 0.5, 0.5)), 0.5, 30, 30)
    found, _ = in_vectors(renderer, camera, RenderOptions(termination=0.0), MANY)
    rays, ids = begun(camera, renderer.pose)
    lines = [a.numpy()[ids].astype(float) for a in (rays.origins, rays.directions)]
    expected_ray, _, _, t_in, t_out, *_ = ray_pieces(field.definition, rest.astype(float), *lines)
    off = []
    for number, rows in enumerate(found):
        expected = np.sort((0.5 * (t_in + t_out))[expected_ray == number])
        if len(expected) == len(rows):
            off.append(abs(rows[:, -1] - expected) / np.spacing(rows[:, -1].astype(np.float32)))
    assert len(off) > 0.98 * len(found)
    assert np.quantile(np.concatenate(off), 0.9) < 0.85  # units in the last place of t


@pytest.mark.parametrize("slot_count", [5, 16])
def test_rounds_end_where_those_of_march_ray_end(make_ball_field, slot_count):
    """Rays without entries of their own are marched one by one, also to where dark is expected."""
    rng = np.random.default_rng()
    renderer = Renderer(make_ball_field(int(rng.integers(1000))), "cpu")
    rest = renderer.field.mesh.rest_vertices
    flat = rest * np.where(rest[:, 2:] > 0.5, (1.0, 1.0, 0.02), 1.0)  # tets that fade
    renderer.set_vertices(flat + (0.0, 0.0, 0.5) * (rest[:, 2:] > 0.5))
    camera = from_field_of_view(look_at((1.7, -0.7, 1.0), (0.5, 0.5, 0.5)), 0.5, 45, 37)
    found, shades = [], rng.uniform(0.05, 1.0, camera.width * camera.height)
    for with_entries in (True, False):
        rays, ids = begun(camera, renderer.pose)
        # Rays through an edge search in both cases.
        ids = np.flatnonzero(rays.entries.count.numpy() > 0)
        if not with_entries:
            rays.entries = Entries()
        pixels = empty_pixels(len(rays.t), "cpu")
        pixels.transmittance.assign(shades)
        alive = wp.array(ids, dtype=int, device="cpu")
        march, options = renderer.host_rounds._on_cpu.march, RenderOptions(termination=0.03)
        for _ in range(3):
            _, counts = march(rays, alive, slot_count, pixels, options)
            state = [a.numpy()[ids] for a in (rays.tet, rays.piece, rays.entry_face, rays.t)]
            found.append((counts.numpy(), *state))
    assert len(ids) > 300 and np.ptp(found[0][0]) > 2
    for one, other in zip(found[:3], found[3:], strict=True):
        same = np.logical_and.reduce([a == b for a, b in zip(one[:4], other[:4], strict=True)])
        assert same.mean() > 0.99
        np.testing.assert_allclose(one[4][same], other[4][same], atol=1e-5)


def test_rays_that_have_to_search_are_marched_as_well(make_ball_field):
    renderer = Renderer(make_ball_field(5), "cpu")
    camera = from_field_of_view(look_at((0.5, 0.5, 0.52), (1.0, 0.6, 0.5)), 1.2, 30, 20)  # inside
    image = renderer.render(camera, RenderOptions(conformance=True)).color_array()
    origins, directions = camera_rays(camera)
    expected, _, _ = render_rays(
        renderer.field.definition, rest_of(renderer), origins, directions, (1.0, 1.0, 1.0)
    )
    off = np.abs(image[..., :3].reshape(-1, 3) / 255.0 - expected).max(axis=1)
    assert np.ptp(expected) > 0.2 and np.mean(off < 2.5 / 255.0) > 0.99


def rest_of(renderer):
    return renderer.field.mesh.rest_vertices.astype(float)
