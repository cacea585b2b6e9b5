"""The section on rendering says what was measured: its findings, tables and picture."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from deformrf.core.render import Renderer, camera_rays
from deformrf.wings.lab.effort import EFFORTS
from deformrf.wings.lab.rendering import pictures
from deformrf.wings.lab.rendering import tell as rendering
from deformrf.wings.lab.rendering.measure import (
    BOUND,
    LARGEST,
    RenderingRow,
    RenderingStudy,
    settings,
)
from deformrf.wings.lab.rendering.pictures import Photograph
from deformrf.wings.lab.report.parts import record
from deformrf.wings.lab.stopwatch import Share, Timing

TURNS = 2


def study_of(field, **sizes):
    return RenderingStudy(field, "cpu", EFFORTS[True, True]._replace(**sizes))


@pytest.fixture(scope="module")
def study(ball):
    return study_of(ball, size=24, view_count=2, pixel_count=60)


@pytest.fixture(scope="module")
def section(study):
    return rendering.section(study, TURNS)


@pytest.fixture(scope="module")
def photos(study):
    picture = study.pictures[0]
    origins, directions = (array[picture.pixels] for array in camera_rays(picture.camera))
    colors = picture.expected
    return [Photograph(origins[i::5], directions[i::5], colors[i::5]) for i in range(5)]


def rows_of(section):
    return section.tables[0].rows


def opened(figure):
    image = Image.open(io.BytesIO(figure))
    assert image.format == "PNG"
    return np.asarray(image.convert("RGB")).astype(int)


def share_of(color, image):
    """Of the pixels, those of nearly that color."""
    return (np.abs(image - color).max(axis=2) < 12).mean()


def test_findings_are_those_of_the_default(section):
    default = rows_of(section)[0]
    first = section.findings[0]
    assert default.setting == "default" and default.default
    assert "24 × 24 pixels" in first
    assert f"{default.frame.median:.3g} ms" in first
    assert f"{default.psnr:.1f} dB" in first and f"{default.worst_psnr:.1f} dB" in first
    assert f"{default.largest:.1f}/255" in first


def test_the_verdict_is_the_rules(section):
    [chosen] = [row for row in rows_of(section) if row.chosen]
    verdict = section.findings[1]
    if chosen.default:
        assert verdict.endswith("gives the default here.")
    else:
        assert f"“{chosen.setting}”" in verdict and f"{chosen.worst_psnr:.1f} dB" in verdict
    assert f"{BOUND:g} dB" in verdict and f"{LARGEST:g}/255" in verdict


def test_every_setting_has_a_row(section, study):
    table, stages = section.tables
    compared = settings(study.field.layout.level_count, study.half)
    assert [row.setting for row in table.rows] == [setting.name for setting in compared]
    assert (section.key, table.name, stages.name) == ("rendering", "rendering", "stages")
    for part in section.tables:
        assert set(part.headings) <= {field for row in part.rows for field in vars(row)}
    assert "photo_psnr" not in table.headings
    shading = {"shade"} if study.device.is_cpu else {"networks"}
    assert {row.stage for row in stages.rows} >= {"pose", "overlap", "march"} | shading
    assert sum(row.time.median for row in stages.rows) > 0.0
    assert record(table.rows[0])["frame_ms"] == table.rows[0].frame.median


def test_values_are_what_was_measured(section, study):
    error = pictures.discretization(study.field, study.pictures, rendering.DISCRETIZATION_PIXELS)
    assert section.values["reference_psnr"] == error.psnr
    assert section.values["reference_largest"] == error.largest
    assert (section.values["bound"], section.values["largest_bound"]) == (BOUND, LARGEST)
    times = section.values["times"]
    assert list(times) == [row.setting for row in rows_of(section)]
    assert all(len(turns) == TURNS for turns in times.values())
    method = " ".join(section.method)
    assert "2 views" in method and "120 random pixels" in method
    assert f"{error.psnr:.1f} dB" in method and f"{TURNS} turns" in method


def test_a_good_image_passes(section):
    assert section.passed is True


@pytest.mark.parametrize("pixels, amount", [(1, 10.0), (60, 2.0)])
def test_beyond_either_bound_it_does_not(ball, pixels, amount):
    """Some pixels should be something else than what is shown: by so much, in 1/255."""
    study = study_of(ball, size=12, view_count=1, pixel_count=60)
    [picture] = study.pictures
    renderer = Renderer(ball)
    renderer.set_vertices(picture.vertices)
    shown = renderer.render(picture.camera).color_array()[..., :3].reshape(-1, 3)
    expected = shown[picture.pixels] / 255.0
    expected[:pixels] += np.where(expected[:pixels] < 0.5, amount, -amount) / 255.0
    study.pictures = [replace(picture, expected=expected)]
    wrong = rendering.section(study, 1)
    default = rows_of(wrong)[0]
    assert (default.worst_psnr < BOUND) != (default.largest > LARGEST)
    assert wrong.passed is False


def test_where_nothing_is_good_enough_it_says_so(ball):
    study = study_of(ball, size=12, view_count=1, pixel_count=60)
    study.pictures = [replace(p, expected=1.0 - p.expected) for p in study.pictures]
    wrong = rendering.section(study, 1)
    assert wrong.passed is False and "gives nothing here" in wrong.findings[1]
    assert opened(wrong.figures[0].png).std() > 10.0


def test_photographs_have_a_finding_and_a_column(study, photos):
    shares = []
    section = rendering.section(study, 1, photos, shares.append)
    assert section.tables[0].headings["photo_psnr"] == "photographs [dB]"
    known = [row for row in rows_of(section) if row.photo_psnr is not None]
    best = max(known, key=lambda row: row.photo_psnr)
    finding = section.findings[2]
    assert "5 test views" in finding and f"“{best.setting}”" in finding
    assert f"{rows_of(section)[0].photo_psnr:.2f} dB by default" in finding
    assert f"{best.photo_psnr:.2f} dB at best" in finding
    assert shares == sorted(shares) and shares[-1] == 1.0


def test_without_photographs_nothing_is_said_of_them(section):
    assert len(section.findings) == 2
    assert not any("photograph" in finding for finding in section.findings)


def test_the_figure_shows_every_family(section):
    from matplotlib.colors import to_rgb

    [figure] = section.figures
    assert figure.name == "rendering"
    image = opened(figure.png)
    for family in {row.family for row in rows_of(section)} - {"default"}:
        color = 255.0 * np.array(to_rgb(rendering.COLORS[family]))
        assert share_of(color, image) > 1e-5, family


def test_every_family_has_a_color():
    families = {setting.family for setting in settings(6, True)}
    assert families == {"default", *rendering.COLORS}


def row(setting, family, milliseconds, psnr, **kind):
    frame = Timing(milliseconds, 0.9 * milliseconds, 1.2 * milliseconds, 3)
    kind = {"front": False, "candidate": True, "default": False, "chosen": False, **kind}
    share = 20.0 * milliseconds
    relative = Share(share, 0.9 * share, 1.2 * share, 3)
    return RenderingRow(
        setting, family, psnr, psnr - 1.0, 3.0, 4.0, None, frame, relative, 5.0, **kind
    )


def test_the_default_is_a_star_and_the_choice_a_ring():
    default = row("default", "default", 5.0, 50.0, default=True, front=True)
    other = row("stop 0.1", "termination", 2.0, 46.0, front=True)
    alone, two, ring = (
        opened(rendering.plot(rows))
        for rows in ([default], [default, other], [default, replace(other, chosen=True)])
    )
    assert alone.shape == two.shape == ring.shape
    dark = [(image.max(axis=2) < 40).sum() for image in (two, ring)]
    assert dark[1] > dark[0] + 50  # the ring and its label
    wide = opened(rendering.plot([replace(default, frame=Timing(5.0, 2.0, 9.0, 3))]))
    assert (wide != alone).any(axis=2).sum() > 50
    blue = np.array([31, 119, 180])  # matplotlib's "tab:blue"
    assert share_of(blue, alone) == 0.0 < share_of(blue, two)
