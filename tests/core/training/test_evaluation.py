"""Scores of a model: against its own renders, for known errors, and after an interrupt."""

import json
import time
from dataclasses import replace

import numpy as np
import pytest
from image_datasets import from_images
from PIL import Image

from deformrf.commands.evaluate import print_report
from deformrf.core.field import FieldOptions, modelfile, random_field
from deformrf.core.geometry import a15_grid, tet_neighbours
from deformrf.core.render import Renderer, from_field_of_view, look_at, pinhole
from deformrf.core.training import UNTOLD, evaluate, evaluation
from deformrf.core.training.run.surroundings import LearnedSurroundings, random_surroundings

SIZE = 16
VIEWS = 3


@pytest.fixture(scope="module")
def field():
    """A small field of random colors; its world is scaled by three and shifted."""
    mesh = a15_grid(0.25)
    options = FieldOptions(2, 2**10, (16,), (16,), march_step=0.05)
    field = random_field(mesh, tet_neighbours(mesh.tets), options)
    field.world_to_model[:3, :3] /= 3.0
    field.world_to_model[:3, 3] = 0.4, 0.5, 0.6
    return field


@pytest.fixture(scope="module")
def dataset(field):
    """Renders of the field from around it, as photographs in its world."""
    renderer = Renderer(field)
    model_to_world = np.linalg.inv(field.world_to_model)
    poses, images = [], []
    for angle in np.linspace(0.0, 4.0, VIEWS):
        eye = np.array([0.5 + 1.5 * np.cos(angle), 0.5 + 1.5 * np.sin(angle), 0.9])
        pose = look_at(eye, (0.5, 0.5, 0.5))
        view = from_field_of_view(pose, 0.7, SIZE, SIZE)
        images.append(renderer.render(view).color_array())
        poses.append(look_at(*((model_to_world @ [*p, 1])[:3] for p in (eye, [0.5] * 3))))
    images = np.stack(images)
    images[..., 3] = 255  # a photograph over white, without alpha
    names = tuple(f"r_{i}" for i in range(VIEWS))
    return from_images(images, poses, [view.lens] * VIEWS, names, "test")


def test_several_rays_a_pixel_come_closer_to_what_a_camera_averages(make_ball_field):
    """The truth is averaged over 6 x 6 rays a pixel."""
    field = make_ball_field(int(np.random.default_rng().integers(1000)))
    pose = look_at((1.6, -0.9, 1.0), (0.5, 0.5, 0.5))
    fine = Renderer(field).render(from_field_of_view(pose, 0.6, 6 * 24, 6 * 24))
    parts = fine.color_array().astype(float).reshape(24, 6, 24, 6, 4)
    image = np.round(parts.mean(axis=(1, 3))).astype(np.uint8)
    image[..., 3] = 255  # over white
    view = from_field_of_view(pose, 0.6, 24, 24)
    dataset = from_images(image[None], [pose], [view.lens], ("r_0",), "test")
    one, four = (evaluate(field, dataset, samples=count) for count in (1, 4))
    assert (one["samples"], four["samples"]) == (1, 4)
    assert four["mean"]["psnr"] > one["mean"]["psnr"] + 2.0
    assert one["mean"]["psnr"] == one["mean"]["psnr_one_ray"] == four["mean"]["psnr_one_ray"]


class FakeRenderer:
    """Renders the constant `color`, and is interrupted at view number `interrupted_at`."""

    color, interrupted_at = (0, 0, 0, 255), None

    def __init__(self, field, device):
        self.render_count = -1  # the first is the warm-up

    def render(self, camera, options):
        assert options.background == (1.0, 1.0, 1.0)
        if self.render_count == self.interrupted_at:
            raise KeyboardInterrupt
        self.render_count += 1
        self.pixels = np.full((camera.height, camera.width, 4), self.color, np.uint8)
        return self

    def color_array(self):
        return self.pixels


@pytest.fixture
def fake(monkeypatch):
    monkeypatch.setattr(evaluation, "Renderer", FakeRenderer)
    return monkeypatch


def constant_views(color):
    images = np.full((VIEWS, SIZE, SIZE, 4), color, np.uint8)
    poses = np.tile(np.eye(4), (VIEWS, 1, 1))
    return from_images(images, poses, [pinhole(20.0, SIZE, SIZE)] * VIEWS, "abc", "test")


def test_a_model_equals_its_own_renders(field, dataset, tmp_path):
    """Through world_to_model: the data set's cameras are in the world."""
    assert np.ptp(dataset.pixels[:, :3]) > 100, "an empty image would prove nothing"
    report = evaluate(field, dataset, tmp_path, samples=1)
    assert report["complete"]
    assert report["mean"]["ssim"] == pytest.approx(1.0, abs=1e-3)
    assert report["mean"]["psnr"] is None or report["mean"]["psnr"] > 50.0
    assert report["mean"]["alpha_error"] is None, "the images have no alpha"
    assert report["model"] == {
        "vertices": field.mesh.vertex_count,
        "tets": field.mesh.tet_count,
        "levels": 2,
        "entries": list(field.layout.entry_counts),
        "occupied_share": 1.0,
    }


def test_scores_of_a_constant_error(fake, field):
    """Black against 51/255 gray at opacity 204/255, which over white is 0.2·0.8 + 0.2."""
    report = evaluate(field, constant_views((51, 51, 51, 204)))
    error = 0.2 * 0.8 + 0.2
    assert report["mean"]["psnr"] == pytest.approx(-20 * np.log10(error), abs=1e-4)
    assert report["mean"]["alpha_error"] == pytest.approx(0.2)
    assert [view["name"] for view in report["views"]] == ["a", "b", "c"]


def test_pixels_of_which_masks_tell_nothing_are_left_out(fake, field):
    """They would be white background; without masks an opacity of 1/255 is one."""
    views = constant_views((51, 51, 51, 204))
    untold = np.arange(len(views.pixels)) % SIZE < SIZE // 2
    views.pixels[untold] = (250, 250, 250, UNTOLD)
    plain = evaluate(field, views)["mean"]
    masked = evaluate(field, replace(views, masked=True))["mean"]
    error = 0.2 * 0.8 + 0.2
    for name in ("psnr", "psnr_one_ray"):
        assert masked[name] == pytest.approx(-20 * np.log10(error), abs=1e-4)
        assert plain[name] < masked[name] - 3.0
    assert masked["alpha_error"] == pytest.approx(0.2) != plain["alpha_error"]
    assert masked["ssim"] > 100.0 * plain["ssim"]
    views.pixels[:, 3] = UNTOLD
    nothing = evaluate(field, replace(views, masked=True))["mean"]
    assert nothing["psnr"] is None and nothing["alpha_error"] is None


def test_equal_images_have_no_psnr_in_json(fake, field, tmp_path):
    report = evaluate(field, constant_views((0, 0, 0, 255)), tmp_path)
    assert report["mean"]["psnr"] is None
    assert json.loads((tmp_path / "report.json").read_text()) == report


def test_images_show_render_truth_and_difference(fake, field, tmp_path):
    fake.setattr(FakeRenderer, "color", (110, 100, 0, 77))
    evaluate(field, constant_views((100, 100, 200, 255)), tmp_path)
    assert sorted(p.name for p in tmp_path.glob("*.png")) == ["000_a.png", "001_b.png", "002_c.png"]
    picture = np.asarray(Image.open(tmp_path / "001_b.png"))
    assert picture.shape == (SIZE, 4 * SIZE, 3)
    parts = picture.reshape(SIZE, 4, SIZE, 3)
    assert (parts[:, 0] == (110, 100, 0)).all()
    assert (parts[:, 1] == (100, 100, 200)).all()
    assert (parts[:, 2] == (40, 0, 255)).all()
    assert (parts[:, 3] == 77).all()


def test_lpips_is_averaged_too(fake, field, capsys):
    report = evaluate(field, constant_views((9, 9, 9, 255)), lpips=lambda a, b: 0.25)
    assert report["mean"]["lpips"] == 0.25
    print_report(report)
    assert "not computed" not in capsys.readouterr().out


def test_without_weights_lpips_is_said_to_be_missing(fake, field, capsys):
    report = evaluate(field, constant_views((9, 9, 9, 255)))
    assert report["mean"]["lpips"] is None
    print_report(report)
    assert "LPIPS: not computed" in capsys.readouterr().out


def test_the_report_has_the_sizes_of_the_file_s_parts(fake, field, tmp_path, capsys):
    path = tmp_path / "m.npz"
    modelfile.save(field, path)
    report = evaluate(field, constant_views((9, 9, 9, 255)), model_path=path)
    facts = report["model"]
    assert facts["bytes"] == path.stat().st_size
    assert 0 < facts["mesh_bytes"] < facts["bytes"]
    assert 0 < facts["table_bytes"] < facts["bytes"]
    assert facts["mesh_bytes"] + facts["table_bytes"] < facts["bytes"]
    print_report(report)
    assert "MB, mesh " in capsys.readouterr().out


@pytest.mark.parametrize("done", [0, 2])
def test_ctrl_c_leaves_a_report_of_what_is_done(fake, field, tmp_path, capsys, done):
    fake.setattr(FakeRenderer, "interrupted_at", done)
    report = evaluate(field, constant_views((9, 9, 9, 255)), tmp_path, samples=1)
    assert not report["complete"]
    assert len(report["views"]) == len(list(tmp_path.glob("*.png"))) == done
    assert json.loads((tmp_path / "report.json").read_text()) == report
    print_report(report)
    assert f"the mean is that of the {done} views done" in capsys.readouterr().out


def test_on_the_cpu_nothing_is_scored_while_a_view_is_timed(fake, field):
    scoring, score_view = [], evaluation.score_view

    def slow_score(*arguments):
        scoring.append(1)
        time.sleep(0.05)
        scoring.pop()
        return score_view(*arguments)

    class Watching(FakeRenderer):
        def render(self, camera, options):
            assert not scoring
            time.sleep(0.01)
            return super().render(camera, options)

    fake.setattr(evaluation, "Renderer", Watching)
    fake.setattr(evaluation, "score_view", slow_score)
    report = evaluate(field, constant_views((9, 9, 9, 255)))
    assert len(report["views"]) == VIEWS


def test_surroundings_are_compiled_before_the_first_view_is_timed(field, dataset, monkeypatch):
    """Else the seconds of the first view include the compilation."""
    ray_counts, forward = [], LearnedSurroundings.forward

    def counted(self, origins, *rest):
        ray_counts.append(len(origins))
        return forward(self, origins, *rest)

    monkeypatch.setattr(LearnedSurroundings, "forward", counted)
    around = random_surroundings(np.array([[0.0] * 3, [1.0] * 3]))
    evaluate(replace(field, surroundings=around), dataset, samples=1)
    assert ray_counts == [8 * 8, *[SIZE * SIZE] * VIEWS]


def test_images_too_small_for_ssim_are_refused(field, dataset):
    images = [dataset.image(view)[:8] for view in range(VIEWS)]
    lenses = [pinhole(20.0, SIZE, 8)] * VIEWS
    small = from_images(images, dataset.poses, lenses, dataset.names, "test")
    with pytest.raises(ValueError, match="these have 16x8"):
        evaluate(field, small)
