"""Ways to render, side by side: what each must cost and lose, and which one the rule picks."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from deformrf.core.field import FieldOptions
from deformrf.core.render import Renderer, RenderOptions, camera_rays
from deformrf.core.render.render_options import checked
from deformrf.wings.lab import rule
from deformrf.wings.lab.effort import EFFORTS
from deformrf.wings.lab.rendering import measure as rendering
from deformrf.wings.lab.rendering import pictures
from deformrf.wings.lab.rendering.measure import (
    BOUND,
    LARGEST,
    TERMINATIONS,
    RenderingStudy,
    Setting,
)
from deformrf.wings.lab.rendering.pictures import Photograph

SIZE, PIXELS, TURNS = 24, 60, 2
EFFORT = EFFORTS[True, True]._replace(size=SIZE, view_count=2, pixel_count=PIXELS)


@pytest.fixture
def study(make_ball_field, device):
    return RenderingStudy(make_ball_field(7), device, EFFORT)


@pytest.fixture
def measured(study):
    """Measure settings by their names: the rows by name."""

    def measure(*names, **arguments):
        named = {s.name: s for s in rendering.settings(study.field.layout.level_count, study.half)}
        rows = study.measure([named[name] for name in names], TURNS, **arguments)
        assert [row.setting for row in rows] == list(names)
        return dict(zip(names, rows, strict=True))

    return measure


@pytest.mark.parametrize("half, wavefront", [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize("level_count", [1, 2, 3, 8])
def test_settings_differ_from_default_mode(level_count, half, wavefront):
    default, *others = found = rendering.settings(level_count, half, wavefront=wavefront)
    assert default.options == RenderOptions() and default.candidate
    assert len({setting.name for setting in found}) == len(found)
    kinds = [(setting.options, setting.scale, setting.masked) for setting in found]
    assert len(set(kinds)) == len(kinds)
    assert any(setting.options.single_precision for setting in others) == half
    assert any(setting.options.path == "host" for setting in others) == wavefront
    for setting in found:
        taken = checked(setting.options, FieldOptions(level_count))
        assert replace(taken, termination=setting.options.termination) == setting.options
        assert taken.stop == setting.options.stop


def test_default_mode_keeps_steps_pixels_and_mask():
    """It may end rays, leave levels out and use half precision, and it needn't conform."""
    for setting in rendering.settings(6, True):
        options, whole = setting.options, setting.scale == 1 and setting.masked
        shown = options.step_factor == 1.0 and not (options.conformance or options.path != "auto")
        may = whole and shown
        assert setting.candidate == may, setting


def test_exactness_costs_what_it_is_known_to(measured):
    """A ray that ends earlier has fewer samples, and is farther from one that doesn't."""
    stops = [stop for stop in TERMINATIONS if stop != RenderOptions().stop]
    rows = measured("default", "conformance", *(f"stop {stop:g}" for stop in stops))
    assert rows["conformance"].psnr > rows["default"].psnr > rows["stop 0.2"].psnr + 3.0
    rows[f"stop {RenderOptions().stop:g}"] = rows["default"]
    in_order = [rows[f"stop {stop:g}"] for stop in TERMINATIONS]
    for longer, shorter in pairwise(in_order):
        assert shorter.psnr < longer.psnr + 0.3  # rounding to bytes may help one
        assert shorter.samples <= longer.samples
    for row in rows.values():
        assert row.worst_psnr <= row.psnr and row.largest <= 255.0


def test_rows_are_those_of_their_times(measured, study):
    rows = measured("default", "no mask", "conformance", "1/2 of the pixels a side")
    assert list(study.times) == list(rows)
    for name, row in rows.items():
        assert row.frame.count == len(study.times[name]) == TURNS
        assert 0.0 < row.frame.low <= row.frame.median <= row.frame.high < np.inf
        assert row.frame.median == pytest.approx(np.median(study.times[name]))
        assert row.default == (name == "default")
        assert row.photo_psnr is None
    shares = [row.relative.median for row in rows.values()]
    front = rule.front(shares, [-row.psnr for row in rows.values()])
    assert [row.front for row in rows.values()] == front.tolist() and front.any()


def test_the_choice_is_a_candidate_within_the_bounds(measured):
    rows = measured("default", "stop 0.2", "1 level less", "conformance", "step × 4").values()
    [chosen] = [row for row in rows if row.chosen]
    assert chosen.setting == "default" and chosen.worst_psnr >= BOUND
    for row in rows:
        within = row.worst_psnr >= BOUND and max(row.largest, row.largest_anywhere or 0) <= LARGEST
        assert (row.candidate and within) == row.chosen


def test_what_default_mode_may_not_do_is_not_chosen(study):
    assert study.measure([Setting("exact", "exact", candidate=True)], 1)[0].chosen
    assert not study.measure([Setting("exact", "exact")], 1)[0].chosen


def as_shown(study):
    """The pictures, if what default mode shows were right."""
    renderer, found = Renderer(study.field, study.device), []
    for picture in study.pictures:
        renderer.set_vertices(picture.vertices)
        shown = renderer.render(picture.camera).color_array()[..., :3].reshape(-1, 3)
        found.append(replace(picture, expected=shown[picture.pixels] / 255.0))
    return found


def moved(colors, amount):
    """By so much [1/255], to where colors can be."""
    return colors + np.where(colors < 0.5, amount, -amount) / 255.0


def test_one_pixel_far_off_is_too_much(measured, study):
    """Even where PSNR, and so every other pixel, is within the bound."""
    one, other = study.pictures = as_shown(study)
    assert measured("default")["default"].chosen
    expected = one.expected.copy()
    expected[0] = moved(expected[0], 10.0)
    study.pictures = [replace(one, expected=expected), other]
    row = measured("default")["default"]
    assert row.worst_psnr > BOUND and row.largest > LARGEST and not row.chosen


def test_what_random_pixels_miss_is_too_much_as_well(make_ball_field, device):
    """A ray's early end is seen in the object; the only pixel compared is beside it."""
    study = RenderingStudy(make_ball_field(7), device, EFFORT)
    study.pictures = [
        pictures.picture_of(study.field, p.vertices, p.camera, np.array([0]))
        for p in study.pictures
    ]
    early = Setting("early", "termination", RenderOptions(termination=0.2), candidate=True)
    compared = [Setting("default", "default", candidate=True), early, rendering.CONFORMANCE]
    default, early, conformance = study.measure(compared, TURNS)
    assert early.worst_psnr > 50.0  # of white
    assert early.largest_anywhere > LARGEST and not early.chosen
    assert abs(early.largest - early.largest_anywhere) < 2.0  # a suspect, of which 16 are enough
    assert 0.0 < default.largest_anywhere < LARGEST and default.chosen
    assert conformance.largest_anywhere is None and conformance.largest < 1.0


def test_the_worst_channel_of_each_pixel_counts():
    images = np.uint8([np.full((2, 3, 3), 200), np.zeros((2, 3, 3))])
    others = images.copy()
    assert not rendering.differences(images, others).any()
    others[0][1, 2], others[1][0, 0, 2] = (210, 197, 200), 17
    for pair in ((images, others), (others, images)):
        one, other = rendering.differences(*pair)
        assert (one[1, 2], other[0, 0], one.sum(), other.sum()) == (10, 17, 10, 17)


def test_the_worst_view_decides(measured, study):
    one, other = as_shown(study)
    study.pictures = [one, replace(other, expected=moved(other.expected, 1.6))]
    row = measured("default")["default"]
    assert row.worst_psnr == pytest.approx(20.0 * np.log10(255.0 / 1.6))
    assert row.psnr > BOUND > row.worst_psnr and row.largest < LARGEST
    assert not row.chosen


def test_samples_are_those_of_a_pixel(measured, study):
    """On average over all pixels of all views."""
    renderer = Renderer(study.field, study.device)
    renderer.set_vertices(study.field.mesh.rest_vertices)
    counts = [renderer.render(picture.camera).sample_count for picture in study.pictures]
    assert measured("default")["default"].samples == pytest.approx(np.mean(counts) / SIZE**2)


def test_fewer_pixels_cost_fewer_samples(measured):
    rows = measured("default", "1/2 of the pixels a side", "1/4 of the pixels a side")
    samples = np.array([row.samples for row in rows.values()])
    np.testing.assert_allclose(samples / samples[0], [1.0, 1 / 4, 1 / 16], rtol=0.25)
    psnr = [row.psnr for row in rows.values()]
    assert psnr[0] > 20.0 + max(psnr[1:]) and min(psnr) > 10.0


@pytest.mark.parametrize("full", [False, True])
def test_without_a_mask_a_full_one_is_not_missed(make_ball_field, device, full):
    field = make_ball_field(7)
    if full:
        field = replace(field, occupancy=np.full_like(field.occupancy, rendering.FULL))
    study = RenderingStudy(field, device, EFFORT)
    compared = [Setting("default", "default"), Setting("no mask", "mask", masked=False)]
    masked, unmasked = study.measure(compared, 1)
    if full:
        assert unmasked.psnr == pytest.approx(masked.psnr)
        assert unmasked.samples == masked.samples
    else:
        assert unmasked.psnr < masked.psnr - 10.0 and unmasked.samples > masked.samples


def test_photographs_are_compared_in_whole_images(measured, study):
    picture = study.pictures[0]
    origins, directions = (array[picture.pixels] for array in camera_rays(picture.camera))
    photos = [Photograph(origins, directions, picture.expected)]
    rows = measured("default", "1 level less", "1/2 of the pixels a side", photos=photos)
    assert rows["default"].photo_psnr > BOUND > rows["1 level less"].photo_psnr
    assert rows["1/2 of the pixels a side"].photo_psnr is None


def test_the_share_that_is_done_grows_to_all(measured):
    shares = []
    measured("default", "conformance", "no mask", step=shares.append)
    assert shares == sorted(shares) and shares[0] > 0.0 and shares[-1] == 1.0


def test_the_reference_knows_its_own_error(study):
    own, every = (pictures.discretization(study.field, study.pictures, n) for n in (PIXELS, 500))
    assert own == pictures.discretization(study.field, study.pictures, PIXELS)  # the same pixels
    assert abs(own.psnr - every.psnr) < 6.0 and own.largest <= every.largest


def test_stages_take_time(study):
    stages = study.stages(1)
    shading = {"shade"} if study.device.is_cpu else {"encode", "networks"}
    assert {"pose", "overlap", "march"} | shading <= set(stages)
    assert all(0.0 <= time.low <= time.median <= time.high for time in stages.values())
    assert sum(time.median for time in stages.values()) > 0.0
    study.measure([Setting("default", "default")], 1)
    assert study.stages(2).keys() == stages.keys()


def test_an_enlarged_image_is_interpolated():
    plain = np.full((3, 4, 3), (7, 80, 255), np.uint8)
    image = rendering.enlarged(plain, 9, 8)
    assert image.shape == (8, 9, 3) and (image == plain[0, 0]).all()
    image = np.random.default_rng().integers(256, size=(5, 6, 3), dtype=np.uint8)
    np.testing.assert_array_equal(rendering.enlarged(image, 6, 5), image)
    ramp = np.repeat(np.uint8([[0, 200]])[..., None], 3, axis=2)
    wide = rendering.enlarged(ramp, 8, 1)[0, :, 0].astype(int)
    assert (wide[0], wide[-1]) == (0, 200) and (np.diff(wide) >= 0).all()
    assert ((wide > 0) & (wide < 200)).sum() == 4  # between the two centers
    np.testing.assert_allclose(wide + wide[::-1], 200, atol=1)
