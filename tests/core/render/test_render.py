"""The fast renderer equals the definition: at rest, moved, bent and stretched."""

import io
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from PIL import Image as Picture

from deformrf.core.base import paths
from deformrf.core.definition.image import ray_pieces, render_rays
from deformrf.core.field import modelfile
from deformrf.core.geometry import signed_volumes
from deformrf.core.render import (
    Renderer,
    RenderOptions,
    camera_rays,
    default_stop,
    from_field_of_view,
    look_at,
    render,
)


@pytest.fixture(params=[False, True], ids=["color a sample", "color a ray"])
def make_ball_field(request, make_ball_field):
    return partial(make_ball_field, deferred=request.param)


BACKGROUND = (0.2, 0.5, 0.9)
CONFORMANCE = RenderOptions(background=BACKGROUND, conformance=True)


def rigid(x):
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array(
        [[1, 0, 0], [0, c, s], [0, -s, c]]
    )
    return (x - 0.5) @ turn.T + [0.55, 0.47, 0.52]


def bend(x):
    """By about 70 degrees around an axis beside the ball, without overlap."""
    angle, radius = 2.0 * (x[:, 2] - 0.5), 0.45 + (x[:, 0] - 0.5)
    return np.stack([0.05 + radius * np.cos(angle), x[:, 1], 0.5 + radius * np.sin(angle)], axis=1)


def stretch(x):
    return (x - 0.5) * [0.8, 0.7, 1.6] + 0.5


POSES = {"rest": lambda x: x, "rigid": rigid, "bend": bend, "stretch": stretch}


def camera(size=64):
    rng = np.random.default_rng()
    direction = rng.normal(size=3) * [1, 1, 0.5]
    eye = 0.5 + 1.6 * direction / np.linalg.norm(direction)
    return from_field_of_view(look_at(eye, (0.5, 0.5, 0.5)), 0.6, size, size)


def float32_rays(view):
    """The view's rays in float32, so that both renderers get the same ones."""
    return (a.astype(np.float32).astype(float) for a in camera_rays(view))


@pytest.mark.parametrize("pose", POSES)
def test_conformance_mode_equals_the_reference(assert_conforms, make_ball_field, device, pose):
    field = make_ball_field(int(np.random.default_rng().integers(10_000)))
    vertices = POSES[pose](field.mesh.rest_vertices).astype(np.float32)
    origins, directions = float32_rays(camera())
    renderer = Renderer(field, device)
    renderer.set_vertices(vertices)
    color, opacity, depth = renderer.render_rays(origins, directions, CONFORMANCE)
    expected, expected_opacity, expected_depth = render_rays(
        field.definition, vertices, origins, directions, BACKGROUND
    )
    # The object is in the picture; in a thousand random ones the mean was 0.11 to 0.47.
    assert 0.03 < expected_opacity.mean() < 0.9
    assert_conforms(color, expected, field, vertices, origins, directions, BACKGROUND)
    assert np.abs(opacity - expected_opacity).mean() < 1e-3
    seen = expected_opacity > 0.5
    assert np.abs(depth - expected_depth)[seen].mean() < 1e-3


def flattened(mesh, neighbours, thickness, most=6):
    """Corners of some tets pressed onto the opposite face, where that inverts no other tet."""
    vertices, flat = mesh.rest_vertices.copy(), []
    for tet in np.random.default_rng().permutation(mesh.tet_count):
        for face in range(4):
            a, b, c = vertices[np.delete(mesh.tets[tet], face)]
            normal = np.cross(b - a, c - a)
            normal /= np.linalg.norm(normal)
            corner, moved = mesh.tets[tet, face], vertices.copy()
            moved[corner] -= (1.0 - thickness) * ((vertices[corner] - a) @ normal) * normal
            volumes = signed_volumes(moved, mesh.tets)
            others = np.setdiff1d(np.arange(mesh.tet_count), [*flat, tet])
            if (volumes[others] > 0.1 * volumes.mean()).all() and (volumes[flat] > -1e-12).all():
                vertices = moved
                flat.append(tet)
                break
        if len(flat) == most:
            break
    assert flat
    return vertices


@pytest.mark.parametrize("thickness", [0.0, 1e-6, 1e-4, 3e-3])
def test_flat_tets_hide_nothing_behind_them(assert_conforms, make_ball_field, device, thickness):
    field = make_ball_field(int(np.random.default_rng().integers(10_000)))
    vertices = flattened(field.mesh, field.neighbours, thickness).astype(np.float32)
    origins, directions = float32_rays(camera())
    renderer = Renderer(field, device)
    renderer.set_vertices(vertices)
    color, _, _ = renderer.render_rays(origins, directions, CONFORMANCE)
    expected, _, _ = render_rays(field.definition, vertices, origins, directions, BACKGROUND)
    assert_conforms(color, expected, field, vertices, origins, directions, BACKGROUND)


@pytest.mark.parametrize("pose", [pytest.param("rest", marks=pytest.mark.soak), "twist"])
def test_the_bundled_model_renders_as_defined(assert_conforms, device, pose):
    """Trained contents: thin shells, sharp masks, five thousand tets."""
    field = modelfile.load(paths.DEFAULT_MODEL)
    vertices = field.mesh.rest_vertices
    if pose == "twist":
        angle = 1.2 * (vertices[:, 2] - 0.1)
        x, y = vertices[:, 0] - 0.5, vertices[:, 1] - 0.5
        c, s = np.cos(angle), np.sin(angle)
        vertices = np.column_stack([0.5 + c * x - s * y, 0.5 + s * x + c * y, vertices[:, 2]])
    vertices = vertices.astype(np.float32)
    origins, directions = float32_rays(camera())
    renderer = Renderer(field, device)
    renderer.set_vertices(vertices)
    color, _, _ = renderer.render_rays(origins, directions, CONFORMANCE)
    expected, _, _ = render_rays(field.definition, vertices, origins, directions, BACKGROUND)
    assert_conforms(color, expected, field, vertices, origins, directions, BACKGROUND)


def test_default_mode_reaches_45_decibels(make_ball_field, device):
    """Rays stop earlier and, on CUDA, the networks run in half precision."""
    field = make_ball_field(5)
    origins, directions = float32_rays(camera())
    renderer = Renderer(field, device)
    color, _, _ = renderer.render_rays(origins, directions, RenderOptions(BACKGROUND))
    expected, _, _ = render_rays(
        field.definition, field.mesh.rest_vertices, origins, directions, BACKGROUND
    )
    assert -10 * np.log10(np.mean((color - expected) ** 2)) > 45.0


def test_shorter_steps_are_those_of_a_model_with_a_shorter_step(make_ball_field, device):
    field = make_ball_field(int(np.random.default_rng().integers(10_000)))
    step = np.float32(0.5) * field.options.march_step
    shorter = replace(field, options=replace(field.options, march_step=float(step)))
    view, half = camera(30), replace(CONFORMANCE, step_factor=0.5)
    whole = Renderer(field, device).render(view, CONFORMANCE)
    part = Renderer(field, device).render(view, half)
    expected = Renderer(shorter, device).render(view, CONFORMANCE)
    np.testing.assert_array_equal(part.color_array(), expected.color_array())
    assert part.sample_count == expected.sample_count > 1.3 * whole.sample_count > 0


@pytest.mark.parametrize("parallel", [False, True])
def test_the_image_is_the_rays_in_bytes(make_ball_field, device, parallel):
    field = make_ball_field(6)
    view = camera(40).resized(48, 40)
    if parallel:
        lens = replace(view.lens, focal=(40.0, 40.0))  # pixels a unit
        view = replace(view, lens=lens, parallel=True)
    renderer = Renderer(field, device)
    image = renderer.render(view, CONFORMANCE)
    color, opacity, depth = renderer.render_rays(*camera_rays(view), CONFORMANCE)
    assert image.color_array().shape == (40, 48, 4)
    expected = np.column_stack([color, opacity]).reshape(40, 48, 4) * 255.0
    # The camera's rays are made on the device: a rounding may move a piece across a mask.
    same = np.abs(image.color_array() - expected).max(axis=2) < 0.51 + 0.1
    assert same.mean() > 0.995
    seen = (opacity >= 0.5).reshape(40, 48)
    np.testing.assert_array_equal(np.isfinite(image.depth_array())[same], seen[same])
    seen &= same
    close = np.isclose(image.depth_array()[seen], depth.reshape(40, 48)[seen], rtol=1e-4)
    assert close.mean() > 0.99


def test_without_view_dependence_no_harmonics_are_computed(make_ball_field, device):
    """The image is that of zero weights for the harmonics, from the same samples."""
    field = make_ball_field(12)
    (weights, bias), *rest = field.color_layers
    weights = weights.copy()
    weights[17:] = 0.0  # 16 features and the constant harmonic stay
    field = replace(field, color_layers=((weights, bias), *rest))
    plain = replace(field, options=replace(field.options, view_dependence=False))
    origins, directions = float32_rays(camera(40))
    images = [Renderer(f, device).render_rays(origins, directions)[0] for f in (field, plain)]
    np.testing.assert_allclose(*images, atol=1e-6)


def test_strips_make_up_the_image(make_ball_field, device):
    renderer = Renderer(make_ball_field(7), device)
    view = camera(32)
    whole = renderer.render(view).color_array()
    strips = [renderer.render(view, rows=rows).color_array() for rows in ((0, 5), (5, 32))]
    np.testing.assert_array_equal(np.concatenate(strips), whole)


def test_moving_object_and_camera_together_changes_nothing(make_ball_field, device):
    field = make_ball_field(8)
    view = camera(32)
    renderer = Renderer(field, device)
    before = renderer.render(view, CONFORMANCE).color_array().astype(int)
    rest = field.mesh.rest_vertices
    renderer.set_vertices(rigid(rest))
    columns = np.concatenate([view.camera_to_world[:3, 3:].T, view.camera_to_world[:3, :3].T + 0.5])
    moved = rigid(columns)
    pose = np.eye(4)
    pose[:3, 3], pose[:3, :3] = moved[0], (moved[1:] - rigid(np.full((1, 3), 0.5))).T
    view = from_field_of_view(pose, 0.6, 32, 32)
    after = renderer.render(view, CONFORMANCE).color_array().astype(int)
    assert (np.abs(after - before).max(axis=-1) > 2).mean() <= 2e-3
    assert np.abs(after - before).mean() < 0.1


def test_looking_away_shows_the_background(make_ball_field, device):
    renderer = Renderer(make_ball_field(9), device)
    view = from_field_of_view(look_at((3, 3, 3), (6, 6, 6)), 0.6, 16, 16)
    image = renderer.render(view, RenderOptions(BACKGROUND))
    np.testing.assert_array_equal(image.color_array()[..., 3], 0)
    assert np.abs(image.color_array()[..., :3] / 255.0 - BACKGROUND).max() < 0.5 / 255
    assert np.isinf(image.depth_array()).all()


def test_an_empty_mask_is_empty_space(make_ball_field, device):
    field = make_ball_field(10, occupied_share=0.0)
    image = Renderer(field, device).render(camera(16))
    assert (image.color_array()[..., 3] == 0).all()
    assert image.sample_count == 0


def test_all_paths_and_precisions_show_the_same_image(make_ball_field, device, monkeypatch):
    """All rays merged, in float32, and with the empty tets."""
    field = make_ball_field(occupied_share=0.3, seed=5)
    camera = from_field_of_view(look_at((1.4, 0.2, 1.0), (0.5, 0.5, 0.5)), 0.7, 48, 48)

    def image(options):
        renderer = Renderer(field, device)
        renderer.set_vertices(field.mesh.rest_vertices)
        return renderer.render(camera, options).color_array().astype(int)

    exact = image(RenderOptions(conformance=True))
    assert exact[..., :3].std() > 10  # there is something to see
    merged = image(RenderOptions(conformance=True, path="merge"))
    with monkeypatch.context() as with_empty_tets:
        every = np.arange(field.mesh.tet_count)
        with_empty_tets.setattr(render, "visible_field", lambda field: (field, every))
        whole = image(RenderOptions(conformance=True))
    for other in (merged, whole):
        assert np.abs(other - exact).max() <= 2
    default, single = image(RenderOptions()), image(RenderOptions(single_precision=True))
    assert np.abs(default - single).max() <= 6  # half precision is all that differs


def test_a_larger_termination_takes_fewer_samples(make_ball_field, device):
    field = make_ball_field(seed=6)
    camera = from_field_of_view(look_at((1.4, 0.2, 1.0), (0.5, 0.5, 0.5)), 0.7, 48, 48)
    renderer = Renderer(field, device)
    renderer.set_vertices(field.mesh.rest_vertices)
    counts = [
        renderer.render(camera, RenderOptions(termination=stop)).sample_count
        for stop in (0.0, 1e-3, default_stop(field.options.deferred), 0.5)
    ]
    assert counts == sorted(counts, reverse=True) and counts[0] > counts[-1]
    assert counts[2] == renderer.render(camera).sample_count  # the default


def test_impossible_options_are_named(make_ball_field):
    renderer = Renderer(make_ball_field(11))
    levels = renderer.field.layout.level_count
    for count in (0, levels + 1):
        with pytest.raises(ValueError, match=f"level_count is {count}; .* {levels} levels"):
            renderer.render(camera(8), RenderOptions(level_count=count))
    with pytest.raises(ValueError, match='path is "slow"; take one of auto, host, merge'):
        renderer.render(camera(8), RenderOptions(path="slow"))
    with pytest.raises(ValueError, match="step_factor is 0"):
        renderer.render_rays(*camera_rays(camera(8)), RenderOptions(step_factor=0.0))


def test_details_number_tets_as_the_field_does(make_ball_field, device):
    """The renderer has fewer tets, in another order."""
    field = make_ball_field(int(np.random.default_rng().integers(1000)), occupied_share=0.3)
    assert (field.occupancy == 0).any()
    view = camera(40)
    image = Renderer(field, device).render(view, replace(CONFORMANCE, details=True))
    tet, t = image.tet.numpy().ravel(), image.depth_array().ravel()
    origins, directions = camera_rays(view)
    ray, tets, *_ = ray_pieces(field.definition, field.mesh.rest_vertices, origins, directions)
    seen = np.flatnonzero(np.isfinite(t))
    assert len(seen) > 20
    met = [tet[k] in tets[ray == k] for k in seen]
    assert np.mean(met) > 0.99
    assert (image.samples.numpy().ravel()[seen] > 0).all()


def test_a_wrong_number_of_vertices_is_named(make_ball_field):
    renderer = Renderer(make_ball_field(11))
    with pytest.raises(ValueError, match="17 were given"):
        renderer.set_vertices(np.zeros((17, 3)))


def kinds(vertices):
    """The same positions in the kinds of arrays that programs have."""
    import torch
    import warp as wp

    tensor = torch.from_numpy(vertices.astype(np.float64))
    yield from (vertices, vertices.astype(np.float64), np.asfortranarray(vertices))
    yield from (vertices.tolist(), tensor, tensor.float().requires_grad_().detach())
    devices = ["cpu", *(["cuda:0"] if wp.is_cuda_available() else [])]
    for device in devices:
        if device == "cpu" or torch.cuda.is_available():
            yield tensor.to(device)
        yield wp.array(vertices, dtype=wp.vec3, device=device)
        yield wp.array(vertices.astype(np.float64), dtype=wp.vec3d, device=device)
        yield wp.array(vertices, dtype=float, device=device)


def test_vertices_of_any_kind_are_taken(make_ball_field, device):
    field = make_ball_field(11)
    renderer = Renderer(field, device)
    vertices = bend(field.mesh.rest_vertices).astype(np.float32)
    for given in kinds(vertices):
        renderer.set_vertices(field.mesh.rest_vertices)
        renderer.set_vertices(given)
        assert np.array_equal(renderer.pose.vertices.numpy(), vertices), type(given)


def test_a_tensor_that_wants_gradients_is_refused(make_ball_field, device):
    import torch

    field = make_ball_field(11)
    renderer = Renderer(field, device)
    tensor = torch.tensor(field.mesh.rest_vertices, requires_grad=True)
    with pytest.raises(ValueError, match=r"pass vertices\.detach\(\)"):
        renderer.set_vertices(tensor)
    with pytest.raises(ValueError, match=r"shape \[3, \d+\], not \[V, 3\]"):
        renderer.set_vertices(tensor.detach().T)


def test_what_is_no_camera_is_named(make_ball_field):
    renderer = Renderer(make_ball_field(11))
    for wrong, name in ((look_at((2, 2, 1), (0, 0, 0)), "ndarray"), ([], "list")):
        with pytest.raises(TypeError, match=f"takes a Camera, not {name}: make one with"):
            renderer.render(wrong)


def test_an_image_is_saved_and_shows_itself(make_ball_field, device, tmp_path):
    """As it is seen over the background; formats with losses are near."""
    image = Renderer(make_ball_field(11), device).render(camera(), CONFORMANCE)
    expected = image.color_array()[..., :3]
    assert (expected[0, 0] == np.rint(255 * np.array(BACKGROUND))).all()
    shown = np.asarray(Picture.open(io.BytesIO(image._repr_png_())))
    assert np.array_equal(shown, expected)
    for name in ("a.png", "c.tif", "b.JPG"):
        image.save(str(tmp_path / name))
        saved = np.asarray(Picture.open(tmp_path / name)).astype(int)
        if name == "b.JPG":
            saved, expected = saved.mean(axis=(0, 1)), expected.mean(axis=(0, 1))
        assert np.abs(saved - expected).max() < 1.0
    with pytest.raises(ValueError, match=r"d\.gif: a picture's name ends in \.png"):
        image.save(tmp_path / "d.gif")
    with pytest.raises(OSError, match="can't write"):
        image.save(tmp_path / "no folder" / "a.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.JPG", "c.tif"]


@pytest.mark.parametrize("part", ["table", "density_layers", "color_layers", "mesh"])
def test_numbers_that_are_none_are_refused(make_ball_field, part):
    """A file with them is not loaded; a field can be made in other ways."""
    field = make_ball_field(0)
    value = getattr(field, part)
    if part == "table":
        bad = value + np.float32(np.nan)
    elif part == "mesh":
        bad = replace(value, rest_vertices=value.rest_vertices * np.inf)
    else:
        bad = tuple((w * np.float32(np.nan), b) for w, b in value)
    with pytest.raises(ValueError, match="holds NaN or infinite numbers"):
        Renderer(replace(field, **{part: bad}), "cpu")
