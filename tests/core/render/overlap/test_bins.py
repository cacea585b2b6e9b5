"""The tets of each bin: all that its rays meet, near ones first."""

import numpy as np
import pytest
from fold_poses import folded, from_inside
from slot_rendering import in_slots

from deformrf.core.render import Camera, Lens, Renderer, RenderOptions, from_field_of_view, look_at
from deformrf.core.render.overlap import bins as bins_module

SIZE = 40
OPTIONS = RenderOptions()


def outside(vertices):
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    return look_at(middle + np.array([0.3, -1.4, 0.5]), middle)


def narrow(pose, parallel=False):
    lens = from_field_of_view(pose, 0.7, 30, SIZE).lens
    return Camera(pose, lens, parallel)


def from_far_away(vertices):
    middle = vertices.mean(axis=0)
    pose = look_at(middle + np.array([800.0, -600.0, 100.0]), middle)
    return from_field_of_view(pose, 0.001, SIZE, SIZE)


def with_a_real_lens(vertices):
    radial, tangential = (-0.2, 0.05, 0.0, 0.0), (0.01, -0.02)
    return Camera(
        outside(vertices), Lens(SIZE, SIZE, (30.0, 28.0), (19.0, 22.0), radial, tangential)
    )


def at_a_vertex(vertices):
    pose = look_at(vertices[7], vertices.mean(axis=0))
    return from_field_of_view(pose, 1.2, SIZE, SIZE)


CAMERAS = {
    "outside": lambda vertices: narrow(outside(vertices)),
    "inside": lambda vertices: from_inside(vertices, SIZE),
    "at a vertex": at_a_vertex,
    "parallel": lambda vertices: narrow(outside(vertices), parallel=True),
    "a real lens": with_a_real_lens,
    "far away": from_far_away,
}


def met(vertices, tets, origins, directions):
    """Where rays enter and leave tets, in float64: t_in and t_out, each [R, T]; 0, 0 if not."""
    corners = vertices[tets].astype(float)
    edges = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    inverse = np.linalg.inv(edges + 1e-300 * np.eye(3))
    at = np.einsum("tij,rtj->rti", inverse, origins.astype(float)[:, None] - corners[None, :, 0])
    along = np.einsum("tij,rj->rti", inverse, directions)
    at = np.concatenate([1.0 - at.sum(-1, keepdims=True), at], -1)
    along = np.concatenate([-along.sum(-1, keepdims=True), along], -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -at / along
    t_in = np.where(along > 0.0, t, 0.0).max(-1).clip(0.0)
    t_out = np.where(along < 0.0, t, np.inf).min(-1)
    return np.where(t_out > t_in, t_in, 0.0), np.where(t_out > t_in, t_out, 0.0)


@pytest.mark.parametrize("most_bytes", [bins_module.MOST_BYTES, 4096])
@pytest.mark.parametrize("name", CAMERAS)
def test_a_bin_has_all_tets_that_its_rays_meet(
    name, most_bytes, make_ball_field, device, monkeypatch
):
    """Also those far outside, and in larger bins for want of memory."""
    monkeypatch.setattr(bins_module, "MOST_BYTES", most_bytes)
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(1000)), march_step=0.02)
    vertices = folded(field) + rng.normal(scale=0.004, size=(field.mesh.vertex_count, 3))
    vertices = vertices.astype(np.float32)
    camera = CAMERAS[name](vertices)
    vertices[int(rng.integers(len(vertices)))] += np.float32(3.0) * rng.normal(size=3)
    renderer = in_slots(Renderer(field, device))
    renderer.set_vertices(vertices)
    renderer.render(camera, OPTIONS)
    bins = renderer._windows._bins.bins
    tets, tet_count = bins.tets.numpy(), renderer.shown.mesh.tet_count
    order, nears = tets[:tet_count], bins.nears.numpy()[:tet_count]
    width, _, edge, across, bin_count = bins.layout.numpy()
    words = bins.bits.numpy()[: len(bins.solid) * bin_count].reshape(-1, bin_count)
    has = (words[:, None] >> np.arange(64, dtype=np.uint64)[:, None]) & np.uint64(1)
    has = has.reshape(-1, bin_count)[:tet_count].astype(bool)  # in order

    assert sorted(order) == list(range(tet_count)) and (np.diff(nears) >= 0.0).all()
    rays, count = renderer._wavefront.buffers.rays, camera.width * camera.height
    origins, directions = (a.numpy()[:count] for a in (rays.origins, rays.directions))
    t_in, t_out = met(vertices, renderer.shown.mesh.tets[order], origins, directions)
    scale = 1.0 + np.abs(camera.position).max()
    meets = t_out - t_in > 1e-5 * scale
    pixels = np.arange(len(origins))
    of_ray = has[:, pixels // width // edge * across + pixels % width // edge].T
    assert meets.any() and not (meets & ~of_ray).any()
    assert (nears <= t_in + 1e-5 * scale)[meets].all()
    if name != "at a vertex":  # and few others
        assert of_ray.mean() < 0.35
