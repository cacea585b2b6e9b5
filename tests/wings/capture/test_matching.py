"""What pairs of photographs share: all of it is found, and once only."""

from contextlib import nullcontext
from itertools import combinations

import numpy as np
import pytest
from captures import circle, write_capture
from PIL import Image

from deformrf.wings.capture import comparing, features, find_photos, library, matching, work

pytest.importorskip("pycolmap")
COUNT = 24
MORE = 0.03  # of the pairs, that pycolmap may miss
SURE = 20  # matches that fit together of a pair that has to be found


def quietly(*arguments):
    """A phase that nobody sees."""
    return nullcontext(lambda done: None)


@pytest.fixture(scope="module")
def extracted(tmp_path_factory):
    """The work on photographs of a ring and a black one, with their features."""
    folder = tmp_path_factory.mktemp("photos")
    write_capture(folder, circle(COUNT), np.random.default_rng(7))
    Image.new("RGB", (240, 180)).save(folder / "black.png")
    begun, _ = work.open_work(folder / "work", find_photos(folder)[0], 240)
    features.find_features(begun, quietly)
    return begun


@pytest.fixture
def begun(extracted):
    yield extracted
    with extracted.database() as database:
        database.clear_two_view_geometries()


def shared(begun) -> dict:
    """How many matches of each pair in the database fit together."""
    pycolmap = library.load_pycolmap()
    with begun.database() as database:
        numbers = {i.image_id: work.number_of(i.name) for i in database.read_all_images()}
        keys, counts = database.read_two_view_geometry_num_inliers()
    pairs = ([numbers[key] for key in pycolmap.pair_id_to_image_pair(pair)] for pair in keys)
    return {tuple(sorted(p)): count for p, count in zip(pairs, counts, strict=True) if count}


@pytest.fixture(scope="module")
def expected(extracted):
    """What pycolmap finds by its own matcher and settings."""
    pycolmap = library.load_pycolmap()
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = library.SEED
    pycolmap.match_exhaustive(str(extracted.database_path), verification_options=options)
    found = shared(extracted)
    with extracted.database() as database:
        database.clear_two_view_geometries()
    assert len(found) > 5 * COUNT
    return found


def test_pairs_share_what_pycolmap_finds(begun, expected):
    matching.match_photos(begun, False, quietly, comparing.HostComparer())
    found = shared(begun)
    assert {pair for pair, count in expected.items() if count >= SURE} <= set(found)
    more = {pair for pair, count in found.items() if count >= SURE} - set(expected)
    assert len(more) <= MORE * len(expected)  # pycolmap's neighbors are the nearest only mostly
    assert sum(found.values()) == pytest.approx(sum(expected.values()), rel=0.03)
    with begun.database() as database:
        keys = [image.image_id for image in database.read_all_images()]
        assert all(database.exists_two_view_geometry(*pair) for pair in combinations(keys, 2))


def test_each_photograph_keeps_the_pairs_that_are_most_alike(begun, expected, monkeypatch):
    """Also where none is alike enough."""
    monkeypatch.setattr(matching, "ALIKE", 10**6)
    monkeypatch.setattr(matching, "CLOSEST", 2)
    matching.match_photos(begun, False, quietly, comparing.HostComparer())
    found = shared(begun)
    assert len(found) <= 2 * COUNT < len(expected)
    assert {(i, i + 1) for i in range(COUNT - 1)} <= set(found)


def test_what_was_matched_before_an_interrupt_is_not_matched_again(begun, monkeypatch):
    """But for the pairs of the portion that it cut."""
    compared, original = [], matching.geometry_of

    def told(comparer, one, other):
        if len(compared) == 50:
            raise KeyboardInterrupt
        compared.append(one.places.tobytes() + other.places.tobytes())
        return original(comparer, one, other)

    monkeypatch.setattr(matching, "geometry_of", told)
    monkeypatch.setattr(matching, "PAIRS_AT_ONCE", 2)
    monkeypatch.setattr(matching, "thread_count", lambda: 1)
    with pytest.raises(KeyboardInterrupt):
        matching.match_photos(begun, False, quietly, comparing.HostComparer())
    before, first = shared(begun), set(compared)
    compared.clear()
    with pytest.raises(KeyboardInterrupt):
        matching.match_photos(begun, False, quietly, comparing.HostComparer())
    assert len(first & set(compared)) <= 2
    assert len(before) > 20 and before.items() <= shared(begun).items()
