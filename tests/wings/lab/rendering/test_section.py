"""Settings side by side: what each must cost and lose, which the rule picks, and what is said."""

import io
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from deformrf.core.render import Renderer, RenderOptions, camera_rays, default_stop
from deformrf.core.render.render_options import checked
from deformrf.wings.lab.effort import EFFORTS
from deformrf.wings.lab.rendering import moving, pictures
from deformrf.wings.lab.rendering import section as rendering
from deformrf.wings.lab.rendering.pictures import PhotoPixels
from deformrf.wings.lab.rendering.section import BOUND, LARGEST, TERMINATIONS, Setting
from deformrf.wings.lab.report.contents import record

SIZE, PIXELS, TURNS = 24, 60, 2
EFFORT = EFFORTS[True, True]._replace(size=SIZE, view_count=2, pixel_count=PIXELS, turns=TURNS)
EFFORT = EFFORT._replace(moving_size=SIZE)
DEFAULT = Setting("default", "default", candidate=True)


@pytest.fixture
def renderer(make_ball_field, device):
    field = make_ball_field(7)
    renderer = Renderer(field, device)
    renderer.set_vertices(field.mesh.rest_vertices)
    return renderer


def expected_of(renderer, numbers=None):
    """What the reference shows in two views: at random pixels, or at these."""
    field, found = renderer.field, []
    for seed, camera in enumerate(pictures.views(field, 2, SIZE)):
        some = pictures.random_pixels(camera, PIXELS, seed) if numbers is None else numbers
        rest = field.mesh.rest_vertices
        found.append(pictures.expected_pixels(field, rest, camera, some))
    return found


def shown_by(renderer):
    """The expected pixels, if what default mode shows were right."""
    found = []
    for mine in expected_of(renderer):
        shown = renderer.render(mine.camera).color_array()[..., :3].reshape(-1, 3)
        found.append(mine._replace(colors=shown[mine.numbers] / 255.0))
    return found


def moved(colors, amount):
    """By so much [1/255], to where colors can be."""
    return colors + np.where(colors < 0.5, amount, -amount) / 255.0


def measured(renderer, settings, expected, photos=None):
    rows, _ = rendering.measure(renderer, settings, expected, TURNS, photos, lambda share: None)
    return rows


def named(renderer, *names):
    """Measure settings by their names: the rows by name."""
    known = {setting.name: setting for setting in rendering.settings(renderer)}
    rows = measured(renderer, [known[name] for name in names], expected_of(renderer))
    return dict(zip(names, rows, strict=True))


def test_settings_differ_and_only_default_mode_s_are_candidates(renderer):
    default, *others = found = rendering.settings(renderer)
    assert default.options == RenderOptions() and default.candidate
    assert len({setting.name for setting in found}) == len(found)
    assert len({setting.options for setting in found}) == len(found)
    assert {setting.family for setting in others} <= set(rendering.COLORS)
    for setting in found:
        taken = checked(setting.options, renderer.field.options)
        assert setting.options.termination in (None, taken.termination)
        exact = setting.options.conformance or setting.options.step_factor != 1.0
        assert setting.candidate != exact


def test_exactness_costs_what_it_is_known_to(renderer):
    """A ray that ends earlier has fewer samples, and is farther from one that doesn't."""

    def error(row):
        return 10.0 ** (-0.1 * row.psnr)

    usual = default_stop(False)
    stops = [stop for stop in TERMINATIONS if stop != usual]
    rows = named(renderer, "default", "conformance", *(f"stop {stop:g}" for stop in stops))
    assert rows["conformance"].psnr > rows["default"].psnr > rows["stop 0.2"].psnr + 3.0
    rows[f"stop {usual:g}"] = rows["default"]
    for longer, shorter in pairwise(rows[f"stop {stop:g}"] for stop in TERMINATIONS):
        # Rounding to bytes, an error of 1/12 byte², may help one.
        assert error(longer) < error(shorter) + 0.1 / (12.0 * 255.0**2)
        assert shorter.samples <= longer.samples


def test_the_choice_is_a_candidate_within_the_bounds(renderer):
    rows = named(renderer, "default", "stop 0.2", "1 level less", "conformance", "step × 4")
    [chosen] = [row for row in rows.values() if row.chosen]
    assert chosen.setting == "default" and chosen.worst_psnr >= BOUND
    assert not any(row.within and row.candidate for row in rows.values() if not row.chosen)
    expected = expected_of(renderer)
    assert not measured(renderer, [DEFAULT._replace(candidate=False)], expected)[0].chosen


def test_one_pixel_far_off_is_too_much(renderer):
    """Even where PSNR, and so every other pixel, is within the bound."""
    one, other = shown_by(renderer)
    assert measured(renderer, [DEFAULT], [one, other])[0].chosen
    colors = one.colors.copy()
    colors[0] = moved(colors[0], 10.0)
    row = measured(renderer, [DEFAULT], [one._replace(colors=colors), other])[0]
    assert row.worst_psnr > BOUND and row.largest > LARGEST and not row.chosen


def test_what_random_pixels_miss_is_too_much_as_well(renderer):
    """A ray's early end is seen in the object; the only pixel compared is beside it."""
    early = Setting("early", "termination", RenderOptions(termination=0.2), candidate=True)
    settings = [DEFAULT, early, rendering.CONFORMANCE]
    default, early, conformance = measured(renderer, settings, expected_of(renderer, np.array([0])))
    assert early.worst_psnr > 50.0  # of white
    assert early.largest_anywhere > LARGEST and not early.chosen
    assert 0.0 < default.largest_anywhere < LARGEST and default.chosen
    assert conformance.largest_anywhere is None and conformance.largest < 1.0


def test_the_worst_view_decides(renderer):
    one, other = shown_by(renderer)
    expected = [one, other._replace(colors=moved(other.colors, 1.6))]
    row = measured(renderer, [DEFAULT], expected)[0]
    assert row.worst_psnr == pytest.approx(20.0 * np.log10(255.0 / 1.6))
    assert row.psnr > BOUND > row.worst_psnr and row.largest < LARGEST
    assert not row.chosen


def test_samples_are_those_of_a_pixel(renderer):
    """On average over all pixels of all views."""
    cameras = pictures.views(renderer.field, 2, SIZE)
    counts = [renderer.render(camera).sample_count for camera in cameras]
    assert named(renderer, "default")["default"].samples == pytest.approx(np.mean(counts) / SIZE**2)


def photos_of(expected):
    mine = expected[0]
    origins, directions = (array[mine.numbers] for array in camera_rays(mine.camera))
    return [PhotoPixels(origins[i::5], directions[i::5], mine.colors[i::5]) for i in range(5)]


def share_of(color, png):
    """Of the pixels, those of nearly that color."""
    image = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    return (np.abs(image - color).max(axis=2) < 12).mean()


@pytest.mark.parametrize("with_photos", [False, True])
def test_the_section_says_what_was_measured(ball, with_photos):
    shares, renderer = [], Renderer(ball, "cpu")
    photos = photos_of(expected_of(renderer)) if with_photos else None
    section = rendering.section(ball, "cpu", EFFORT, photos, shares.append)
    [table, moved], [figure] = section.tables, section.figures
    assert moved.name == "moving"
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert [row.setting for row in table.rows] == [s.name for s in rendering.settings(renderer)]
    assert list(section.values["times"]) == [row.setting for row in table.rows]
    assert all(len(turns) == TURNS for turns in section.values["times"].values())
    default = table.rows[0]
    assert record(default)["frame_ms"] == np.median(section.values["times"]["default"])
    first, verdict, *others, last = section.findings
    assert last in moving.findings([moved])
    assert f"{SIZE} × {SIZE} pixels" in first and f"{default.frame.median:.3g} ms" in first
    assert f"{default.psnr:.1f} dB" in first and f"{default.worst_psnr:.1f} dB" in first
    [chosen] = [row for row in table.rows if row.chosen]
    assert ("the default here" if chosen.default else f"“{chosen.setting}”") in verdict
    assert (
        section.passed is True and f"{section.values['reference_psnr']:.1f} dB" in section.method[0]
    )
    assert ("photo_psnr" in table.headings) == with_photos == bool(others)
    if with_photos:
        assert default.photo_psnr > BOUND and f"{default.photo_psnr:.2f} dB by default" in others[0]
    for family in {row.family for row in table.rows} - {"default"}:
        color = 255.0 * np.array(to_rgb(rendering.COLORS[family]))
        assert share_of(color, figure.png) > 1e-5, family


def test_where_nothing_is_good_enough_it_says_so(renderer, device, monkeypatch):
    right = pictures.expected_pixels

    def wrong(*asked):
        found = right(*asked)
        return found._replace(colors=1.0 - found.colors)

    monkeypatch.setattr(pictures, "expected_pixels", wrong)
    section = rendering.section(renderer.field, device, EFFORT)
    assert section.passed is False and "gives nothing here" in section.findings[1]


def test_the_default_is_a_star_and_the_choice_a_ring(renderer):
    default, early = named(renderer, "default", "stop 0.2").values()
    plain, ring = (
        np.asarray(Image.open(io.BytesIO(rendering.plot(rows))).convert("L"))
        for rows in ([default, early], [default, replace(early, chosen=True)])
    )
    assert (ring < 40).sum() > (plain < 40).sum() + 50
