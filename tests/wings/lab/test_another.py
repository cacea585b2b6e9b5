"""A report on two models of one object: what one was trained without, and what that is worth."""

from dataclasses import replace

import pytest

from deformrf.core.field import modelfile
from deformrf.core.render import Renderer, RenderOptions
from deformrf.wings.lab import another
from deformrf.wings.lab.effort import EFFORTS
from deformrf.wings.lab.rendering.pictures import PhotoPixels, random_pixels, view

EFFORT = EFFORTS[True, True]._replace(size=24, frame_turns=3)


@pytest.fixture
def models(make_ball_field, tmp_path):
    """A ball with a color for each ray, and the same with other colors, one for each sample."""
    metas = (
        {"options": {"leave_out": []}, "test_mean": {"psnr": 30.0}, "seconds": 60.0},
        {"options": {"leave_out": ["ray-color"]}, "test_mean": {"psnr": 31.5}, "seconds": 90.0},
    )
    found = []
    for name, meta, deferred in zip(("own", "other"), metas, (True, False), strict=True):
        field = replace(make_ball_field(3, deferred=deferred), meta=meta)
        modelfile.save(field, tmp_path / f"{name}.npz")
        found.append((field, tmp_path / f"{name}.npz"))
    return found


def photographs_of(field):
    """Pixels of what a field looks like."""
    from deformrf.core.render import camera_rays

    camera = view(field, 0.3, 24)
    some = random_pixels(camera, 200, 0)
    origins, directions = (a[some] for a in camera_rays(camera))
    colors, _, _ = Renderer(field).render_rays(
        origins, directions, RenderOptions(background=(1.0, 1.0, 1.0))
    )
    return [PhotoPixels(origins, directions, colors)]


def test_each_model_is_scored_on_the_same_photographs(models):
    photos = photographs_of(models[0][0])
    section = another.section(models, "cpu", EFFORT, [photos, photos])
    own, other = section.tables[0].rows
    assert (own.which, own.left_out, own.color) == ("own", "–", "ray")
    assert (other.which, other.left_out, other.color) == ("other", "ray-color", "sample")
    assert own.photographs > 60.0 > other.photographs + 20.0
    assert own.frame.median > 0.0 and own.frame.count == other.frame.count == 3
    assert own.megabytes == pytest.approx(models[0][1].stat().st_size / 1e6)
    said = f"{other.photographs - own.photographs:+.2f} dB on photographs"
    assert said in section.findings[0] and "all parts but ray-color" in section.findings[0]


@pytest.mark.parametrize("words", [5, [1, {}], "ab", ["\x1b[2J"], {"a": 1}])
def test_words_of_a_file_are_not_repeated(models, words):
    models = [(replace(field, meta={"options": {"leave_out": words}}), p) for field, p in models]
    section = another.section(models, "cpu", EFFORT, [None, None])
    assert {row.left_out for row in section.tables[0].rows} == {"–"}


def test_without_photographs_the_scores_of_the_trainings_count(models):
    section = another.section(models, "cpu", EFFORT, [None, None])
    assert "+1.50 dB on its test views" in section.findings[0]
    models = [(replace(field, meta={}), path) for field, path in models]
    assert "dB" not in another.section(models, "cpu", EFFORT, [None, None]).findings[0]
