"""View modes: each picture equals its NumPy reference, on random fields."""

import sys

import numpy as np
import pytest
from shown_levels import levels_reference

from deformrf.core.field import level_edges
from deformrf.core.render import (
    MODES,
    Renderer,
    RenderOptions,
    camera_rays,
    from_field_of_view,
    look_at,
    modes,
    render_mode,
)

RANGE = 1.2, 2.0
BACKGROUND = (0.2, 0.5, 0.9)
OPTIONS = RenderOptions(BACKGROUND)


def normals_reference(points):
    """Unit normals towards the eye, from points [H, W, 3] relative to it, NaN where none is.

    Returns:
        [H, W, 3], NaN where a pixel has no neighbor across, or none down.
    """
    points = np.asarray(points, float)
    t = np.linalg.norm(points, axis=-1)
    slopes = []
    for axis in (1, 0):
        step = np.diff(points, axis=axis)
        jump = np.abs(np.diff(t, axis=axis))
        missing = np.full_like(np.take(step, [0], axis), np.nan)
        before, after = (np.concatenate(pair, axis) for pair in ((missing, step), (step, missing)))
        missing = missing[..., 0]
        jump_before = np.concatenate([missing, jump], axis)
        jump_after = np.concatenate([jump, missing], axis)
        use_after = np.isnan(jump_before) | (jump_after < jump_before)
        slopes.append(np.where(use_after[..., None], after, before))
    n = np.cross(*slopes)
    length = np.linalg.norm(n, axis=-1, keepdims=True)
    n = np.divide(n, length, out=np.full_like(n, np.nan), where=length > 0)
    return np.where((n * points).sum(axis=-1, keepdims=True) > 0, -n, n)


def tet_colors_reference(tet):
    """The colors 64..255 of tet ids [...], from a hash of the id.  [..., 3] uint8"""
    h = (np.asarray(tet).astype(np.uint64) + 1) * modes.PRIMES[0] & 0xFFFFFFFF
    h ^= h >> 15
    h = h * modes.PRIMES[1] & 0xFFFFFFFF
    h ^= h >> 13
    return np.stack([64 + (h >> shift & 255) * 3 // 4 for shift in (0, 8, 16)], -1).astype(np.uint8)


def heat_reference(x):
    """The colors 0..1 of values [...], 0 dark and 1 (and above) yellow.  [..., 3]"""
    at = np.linspace(0.0, 1.0, len(modes.HEAT))
    return np.stack(
        [np.interp(x, at, column) for column in np.array(modes.HEAT).T / 255.0], axis=-1
    )


@pytest.fixture
def field(make_ball_field):
    return make_ball_field(int(np.random.default_rng().integers(10_000)))


def camera(width=48, height=40):
    angle = np.random.default_rng().uniform(0, 2 * np.pi)
    eye = 0.5 + np.array([1.5 * np.cos(angle), 1.5 * np.sin(angle), 0.4])
    return from_field_of_view(look_at(eye, (0.5, 0.5, 0.5)), 0.6, width, height)


@pytest.fixture
def shown(field, device):
    """A function: a mode's color [H, W, 4] int and alpha's mask, and the plain image."""
    renderer, view = Renderer(field, device), camera()

    def show(mode, rows=None):
        return render_mode(renderer, view, mode, OPTIONS, rows, RANGE)

    show.view, show.renderer = view, renderer
    return show


def picture(image):
    color = image.color_array().astype(int)
    return color[..., :3], color[..., 3] > 0


def expect(image, wanted, mask):
    """Within half a byte of `wanted` 0..1, and the background where nothing is."""
    color, there = picture(image)
    np.testing.assert_array_equal(there, mask)
    assert 0.05 < mask.mean()
    assert np.abs(color - 255 * np.clip(wanted, 0, 1))[mask].max() <= 0.51
    assert np.abs(color - 255 * np.array(BACKGROUND))[~mask].max(initial=0) <= 0.51


def test_depth_is_white_when_near_and_black_when_far(shown):
    t = shown("color").depth_array()
    gray = (RANGE[1] - t) / (RANGE[1] - RANGE[0])
    expect(shown("depth"), np.repeat(gray[..., None], 3, -1), np.isfinite(t))
    assert np.ptp(gray[np.isfinite(t)]) > 0.05


def test_accumulation_is_the_opacity(shown):
    opacity = shown("color").color_array()[..., 3]
    wanted = np.repeat(opacity[..., None], 3, -1) / 255
    expect(shown("accumulation"), wanted, np.ones(opacity.shape, bool))


def test_normals_are_those_of_the_depth_image(shown):
    t = shown("color").depth_array()
    _, directions = camera_rays(shown.view)
    points = np.where(np.isfinite(t)[..., None], t[..., None], np.nan)
    points = points * directions.reshape(*t.shape, 3)
    normals = normals_reference(points)
    color, there = picture(shown("normals"))
    np.testing.assert_array_equal(there, np.isfinite(normals[..., 0]))
    assert there.mean() > 0.05
    # Differences of depths in float32: where they all but vanish, a rounding turns the normal,
    # and where two jumps tie, another neighbour counts.
    close = np.abs(color - 255 * (0.5 + 0.5 * normals))[there].max(axis=-1) < 1.6
    assert close.mean() > 0.99


def test_the_normal_of_a_plane_is_the_planes():
    rng = np.random.default_rng()
    normal = rng.normal(size=3)
    normal[2] = abs(normal[2]) + 2.0  # towards the eye, and not edge on
    normal /= np.linalg.norm(normal)
    _, directions = camera_rays(from_field_of_view(np.eye(4), 0.6, 20, 14))
    points = directions * (-1.5 / (directions @ normal))[:, None]
    points = points.reshape(14, 20, 3)
    points[rng.uniform(size=(14, 20)) < 0.1] = np.nan
    found = normals_reference(points)
    there = np.isfinite(found[..., 0])
    assert there.mean() > 0.5
    np.testing.assert_allclose(found[there], np.tile(normal, (there.sum(), 1)), atol=1e-9)


def test_at_a_silhouette_the_normal_is_that_of_the_pixels_own_surface():
    _, directions = camera_rays(from_field_of_view(np.eye(4), 0.6, 8, 8))
    z = np.where(np.arange(8) < 4, 1.0, 3.0)  # two walls that face the eye
    points = directions.reshape(8, 8, 3) * (z / -directions.reshape(8, 8, 3)[..., 2])[..., None]
    assert normals_reference(points) == pytest.approx(np.broadcast_to([0.0, 0.0, 1.0], (8, 8, 3)))


def test_each_tet_keeps_its_color(shown):
    tet = shown.renderer.render(shown.view, RenderOptions(details=True)).tet.numpy()
    expect(shown("tets"), tet_colors_reference(tet) / 255, tet >= 0)


def test_levels_are_those_that_a_pixel_can_show(shown):
    renderer, t = shown.renderer, shown("color").depth_array()
    count = renderer.field.layout.level_count
    edges = level_edges(renderer.field.mesh, count)
    levels = levels_reference(t, edges, shown.view.focal)
    seen = np.isfinite(t)
    # Where the level changes, depths are rounded to either side.
    changing = levels_reference(1.0001 * t, edges, shown.view.focal) != levels
    image = shown("levels")
    color, there = picture(image)
    np.testing.assert_array_equal(there, seen)
    wanted = 255 * heat_reference(levels / (count - 1))
    assert np.abs(color - wanted)[seen & ~changing].max() <= 0.51


def test_half_the_distance_shows_one_level_more():
    t = np.array([np.inf, 8.0, 4.0, 2.0, 1.0, 1e-3])
    edges = 0.1 / 2.0 ** np.arange(6)
    assert levels_reference(t, edges, 40.0).tolist() == [0, 0, 0, 1, 2, 5]


def test_few_tets_share_a_color():
    ids = np.arange(100_000)
    assert len(np.unique(tet_colors_reference(ids), axis=0)) > 0.9 * len(ids)


def test_heat_shows_the_number_of_samples(shown):
    samples = shown.renderer.render(shown.view, RenderOptions(details=True)).samples.numpy()
    assert samples.max() > 5
    wanted = heat_reference(samples / modes.SAMPLES_SHOWN)
    expect(shown("samples"), wanted, np.ones(samples.shape, bool))


def test_heat_is_dark_at_zero_and_yellow_from_one_on():
    first, last = np.array(modes.HEAT[0]) / 255, np.array(modes.HEAT[-1]) / 255
    found = heat_reference([0.0, 1.0, 7.0])
    assert found == pytest.approx(np.array([first, last, last]))


def test_the_error_is_the_difference_to_conformance_mode(shown):
    view, renderer = shown.view, shown.renderer
    default, exact = (
        renderer.render(view, RenderOptions(BACKGROUND, conformance=c)).color_array().astype(int)
        for c in (False, True)
    )
    error = modes.ERROR_GAIN * np.abs(default - exact)[..., :3] / 255
    assert error.max() > 0
    expect(shown("error"), error, np.ones(error.shape[:2], bool))


@pytest.mark.gpu
@pytest.mark.parametrize("hidden", [(64,), (16,)])  # on tensor cores, and not
def test_pictures_on_a_gpu_need_no_torch(make_ball_field, monkeypatch, hidden):
    """Without torch they are the same within 1/255, which mode error shows ERROR_GAIN times."""
    field, view = make_ball_field(1, density_hidden=hidden), camera()

    def rendered():
        renderer = Renderer(field, "cuda:0")
        images = [
            renderer.render(view, RenderOptions(BACKGROUND, conformance=True)),
            renderer.render(view, RenderOptions(BACKGROUND, single_precision=True)),
            render_mode(renderer, view, "error", RenderOptions(BACKGROUND, single_precision=True)),
            render_mode(renderer, view, "error", OPTIONS),
        ]
        return [picture(image)[0] for image in images]

    with_torch = rendered()
    monkeypatch.setitem(sys.modules, "torch", None)
    without = rendered()
    exact, single, error, _ = (np.abs(a - b) for a, b in zip(with_torch, without, strict=True))
    assert max(exact.max(), single.max()) <= 1
    # Mode error is a difference of two images, each within 1/255.
    assert error.max() <= 2 * modes.ERROR_GAIN
    assert (error > 0).mean() < 0.05
    # With half precision for other widths only torch rounds, but both stay near the exact image.
    assert np.median(without[-1]) <= modes.ERROR_GAIN


@pytest.mark.parametrize("mode", MODES)
def test_strips_make_up_the_picture(shown, mode):
    whole = shown(mode)
    strips = [shown(mode, rows) for rows in ((0, 7), (7, 8), (8, 40))]
    np.testing.assert_array_equal(
        np.concatenate([s.color_array() for s in strips]), whole.color_array()
    )
    depths = np.concatenate([s.depth_array() for s in strips])
    np.testing.assert_array_equal(depths, whole.depth_array())


@pytest.mark.parametrize("mode", MODES)
def test_each_mode_but_color_has_a_caption(mode):
    assert len(modes.caption(mode, RANGE)) < 50
    assert bool(modes.caption(mode, RANGE)) == (mode != "color")
