"""Which views a sector holds out, in closed form on made-up rings, and how a data set is read."""

from dataclasses import replace

import numpy as np
import pytest
from captures import look
from posed_data import PHONE, colmap, nsvf, polycam
from posed_data import transforms as any_transforms

from deformrf.core.training import DatasetError, Sector, find_sector, load_dataset
from deformrf.core.training.data.sector import is_within, sector_of


def transforms(folder, count):
    return any_transforms(folder, count, **PHONE)


def places(azimuths, elevation=20.0, radius=4.0):
    """Cameras that look at the origin from azimuths [degrees].  [n, 4, 4]"""
    a, e = np.radians(azimuths), np.radians(elevation)
    flat = radius * np.cos(e) * np.stack([np.cos(a), np.sin(a)], axis=-1)
    return np.array([look((x, y, radius * np.sin(e)), (0, 0, 0)) for x, y in flat])


def ring(count, begin=0.0, width=360.0, elevation=20.0):
    return places(begin + width * np.arange(count) / count, elevation)


def held(poses):
    """The places of the views that are held out, and the sector."""
    sector = sector_of([str(i) for i in range(len(poses))], poses)
    return [int(name) for name in sector.views], sector


@pytest.mark.parametrize("begin", [0.0, 33.0, -170.0, 359.9999999])
def test_of_an_even_ring_the_first_sixth_is_held_out(begin):
    """From the first view on, counterclockwise; the view after 60° stays."""
    rows, sector = held(ring(24, begin))
    assert rows == [0, 1, 2, 3]
    assert sector.begin == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(sector.up, (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(sector.center, 0.0, atol=1e-9)
    zero = np.cos(np.radians(begin)), np.sin(np.radians(begin)), 0.0
    np.testing.assert_allclose(sector.zero, zero, atol=1e-9)


def test_clockwise_it_ends_at_the_first_view():
    """Views 23, 22, 21 are at 15°, 30°, 45°."""
    rows, _ = held(ring(24)[[0, *range(23, 0, -1)]])
    assert rows == [0, 21, 22, 23]


def test_all_heights_of_the_sector_are_held_out():
    poses = np.concatenate([ring(12), ring(12, elevation=50.0), ring(12, 15.0, elevation=-30.0)])
    rows, sector = held(poses)
    azimuths = np.concatenate([30.0 * np.arange(12)] * 2 + [15.0 + 30.0 * np.arange(12)])
    np.testing.assert_allclose(sector.azimuths(poses), azimuths, atol=1e-6)
    assert rows == [0, 1, 12, 13, 24, 25]
    np.testing.assert_array_equal(np.flatnonzero(sector.contains(poses)), rows)


def test_the_usual_number_is_held_out_and_neither_the_most_nor_the_least():
    """30 views at 0° to 58°, and one each 10° from 60° on: 60 in all, seen from 350° around."""
    crowd, others = np.arange(0.0, 60.0, 2.0), np.arange(60.0, 360.0, 10.0)
    poses = places(np.concatenate([crowd, others]))
    rows, sector = held(poses)
    counts = [is_within(sector.azimuths(poses), begin).sum() for begin in sector.azimuths(poses)]
    usual = 60 * 60 / 350
    assert (min(counts), max(counts)) == (6, 30)
    assert abs(len(rows) - usual) == min(abs(count - usual) for count in counts)


def test_of_half_a_ring_a_full_sector_is_held_out():
    rows, _ = held(places(np.linspace(0.0, 240.0, 25)))
    assert rows == [0, 1, 2, 3, 4, 5]


def test_it_turns_and_grows_with_the_world():
    """The world on its side, three times as large, elsewhere."""
    poses = ring(24, 10.0)
    turn = np.eye(4)
    turn[:3, :3] = [(0, 0, 1), (1, 0, 0), (0, 1, 0)]
    moved = turn @ poses
    moved[:, :3, 3] = 3.0 * moved[:, :3, 3] + (5, -2, 7)
    rows, sector = held(moved)
    assert rows == held(poses)[0]
    np.testing.assert_allclose(sector.center, (5, -2, 7), atol=1e-6)
    np.testing.assert_allclose(sector.up, turn[:3, 2], atol=1e-9)


def test_views_from_straight_above_are_of_no_side():
    """They neither change which sector is held out nor lie in it."""
    steep = np.concatenate([places([10.0, 20.0, 200.0], 75.0), places([30.0, 40.0], -80.0)])
    poses = np.concatenate([ring(24), steep])
    rows, sector = held(poses)
    assert rows == [0, 1, 2, 3]
    np.testing.assert_array_equal(np.flatnonzero(sector.contains(poses)), rows)


def test_a_first_view_from_straight_above_has_no_azimuth():
    above = np.eye(4)
    above[2, 3] = 4.0
    poses = np.concatenate([above[None], ring(24, 80.0)])
    rows, _ = held(poses)
    assert rows == [1, 2, 3, 4]


@pytest.mark.parametrize(
    "poses, sentence",
    [
        (ring(3), "there are 3 training views"),
        (ring(9), "it has only 2 of the 9 training views, and at least 3 are needed for a score"),
        (ring(20, width=160.0), "the cameras see 152° around the object, and at least 180°"),
        (ring(20, elevation=75.0), "the cameras see 0° around the object"),
        (np.tile(np.eye(4), (9, 1, 1)), "the cameras look at no common point"),
        (ring(12) * [-1, 1, -1, 1], "the cameras look at no common point"),
    ],
    ids=["few", "few in it", "not around", "above", "parallel", "outwards"],
)
def test_where_no_sector_can_be_held_out_a_sentence_says_why(poses, sentence):
    with pytest.raises(DatasetError, match="a sector of 60° can't be held out: ") as caught:
        held(poses)
    assert sentence in str(caught.value)


@pytest.mark.parametrize("write", [transforms, nsvf, colmap, polycam])
def test_training_views_and_those_held_out_are_the_training_split(tmp_path, write):
    folder = write(tmp_path, 30)
    whole, sector = load_dataset(folder, "train"), find_sector(folder)
    parts = [load_dataset(folder, split, sector=sector) for split in ("train", "sector")]
    assert [part.split for part in parts] == ["train", "sector"]
    assert parts[0].sector == sector and parts[1].sector is None
    inside = sector.contains(whole.poses)
    assert 3 <= inside.sum() == parts[1].view_count == len(sector.views)
    for part, rows in zip(parts, (~inside, inside), strict=True):
        np.testing.assert_array_equal(part.poses, whole.poses[rows])
        assert part.names == tuple(np.array(whole.names)[rows])
        pixels = [whole.image(i) for i in np.flatnonzero(rows)]
        np.testing.assert_array_equal(part.pixels, np.concatenate(pixels).reshape(-1, 4))
    assert find_sector(folder) == sector


def test_other_splits_are_read_whole(tmp_path):
    folder = transforms(tmp_path, 30)
    sector = find_sector(folder)
    assert load_dataset(folder, "test", sector=sector).view_count == 4


@pytest.mark.parametrize("outside", [False, True])
def test_images_of_one_name_in_two_folders_are_told_apart(tmp_path, outside):
    """As those of a rig of cameras are."""
    folder = transforms(tmp_path / "data", 30)
    where = "../rig" if outside else "images"
    text = (folder / "transforms.json").read_text()
    for i in range(30):
        path = folder / f"{where}/{i // 2 if i % 2 else 100 + i // 2}"
        path.mkdir(parents=True)
        (folder / f"images/{i:04d}.png").rename(path / "a.png")
        text = text.replace(f"images/{i:04d}.png", f"{where}/{path.name}/a.png")
    (folder / "transforms.json").write_text(text)
    sector = find_sector(folder, outside)
    assert len({*sector.views}) == len(sector.views) >= 3
    held = load_dataset(folder, "sector", outside=outside, sector=sector)
    assert held.view_count == len(sector.views)


def test_the_views_of_a_sector_are_unknown_without_it(tmp_path):
    with pytest.raises(DatasetError, match="unknown without the sector"):
        load_dataset(transforms(tmp_path, 9), "sector")


def test_another_data_set_is_refused(tmp_path):
    sector = find_sector(transforms(tmp_path / "a", 30))
    sector = replace(sector, views=(*sector.views, "images/9999.png"))
    sentence = "1 of the 6 views that training held out are no training images of .*9999.png"
    with pytest.raises(DatasetError, match=sentence):
        load_dataset(tmp_path / "a", "sector", sector=sector)


def test_a_report_keeps_it(tmp_path):
    sector = held(ring(24, 77.0))[1]
    assert Sector.of_report(sector.as_report()) == sector
    assert Sector.of_report({}) is None


@pytest.mark.parametrize(
    "key, value",
    [
        ("begin", "here"),
        ("begin", 1e9),
        ("up", [0, 0]),
        ("zero", [0, 0, 9]),
        ("center", None),
        ("views", []),
        ("views", [3]),
    ],
)
def test_what_is_no_sector_is_none(key, value):
    report = held(ring(24))[1].as_report()
    assert Sector.of_report({"sector": {**report["sector"], key: value}}) is None
    del report["sector"][key]
    assert Sector.of_report(report) is None
