"""deformrf edit: smaller models, and what it refuses."""

import numpy as np
import pytest

from deformrf.commands import edit
from deformrf.core import field as fields


@pytest.fixture
def model(make_ball_field, tmp_path):
    path = tmp_path / "model.npz"
    fields.save(make_ball_field(0), path)
    return path


def test_a_box_is_kept(call, model, tmp_path):
    smaller = tmp_path / "smaller.npz"
    box = [0.0, 0.0, 0.5, 1.0, 1.0, 1.0]
    result = call(edit.main, model, "-o", smaller, "--keep-box", *box)
    assert result.code == 0 and f"Wrote {smaller}" in result.out
    before, after = fields.load(model), fields.load(smaller)
    assert after.mesh.tet_count < before.mesh.tet_count
    places = fields.subtet_middles(after.mesh)[fields.unpack_mask(after.occupancy)]
    assert places[:, 2].min() >= 0.5
    assert smaller.stat().st_size < model.stat().st_size
    np.testing.assert_array_equal(after.world_to_model, before.world_to_model)


def test_the_thing_at_a_point_is_kept(call, make_ball_field, tmp_path):
    """Of two halves that nothing joins, the one that is named; other options go on working."""
    model, smaller = tmp_path / "halves.npz", tmp_path / "half.npz"
    fields.save(make_ball_field(0, spacing=0.05, gap=0.1, occupied_share=1.0), model)
    result = call(edit.main, model, "-o", smaller, "--keep-at", 0.35, 0.5, 0.5)
    assert result.code == 0
    assert "Left out 4" in result.out or "Left out 5" in result.out
    assert "% of the matter (in the box" in result.out
    after = fields.load(smaller)
    places = fields.subtet_middles(after.mesh)[fields.unpack_mask(after.occupancy)]
    assert places[:, 0].max() < 0.5
    box = [0.0, 0.0, 0.0, 1.0, 1.0, 0.5]
    flags = ["--keep-at", 0.35, 0.5, 0.4, "--keep-box", *box]
    assert call(edit.main, model, "-o", smaller, *flags).code == 0
    after = fields.load(smaller)
    places = fields.subtet_middles(after.mesh)[fields.unpack_mask(after.occupancy)]
    assert places[:, 0].max() < 0.5 and places[:, 2].max() <= 0.5


def test_a_model_can_be_replaced_by_what_is_left_of_it(call, model):
    count = fields.load(model).mesh.tet_count
    result = call(edit.main, model, "-o", model, "--drop-box", 0, 0, 0, 1, 1, 0.5)
    assert result.code == 0
    assert fields.load(model).mesh.tet_count < count


@pytest.mark.parametrize("bits, flags, wanted", [(8, [], 8), (16, [], 16), (16, [8], 8)])
def test_tables_keep_the_bits_of_their_entries(call, model, bits, flags, wanted):
    fields.save(fields.load(model), model, entry_bits=bits)
    flags = ["--entry-bits", *flags] if flags else []
    assert call(edit.main, model, "-o", model, "--drop-box", 0, 0, 0, 1, 1, 0.5, *flags).code == 0
    with np.load(model) as arrays:
        finest = max(name for name in arrays if name.startswith("table_"))
        assert arrays[finest].dtype.itemsize == wanted // 8


@pytest.mark.parametrize(
    "flags, sentence",
    [
        (["--keep-box", 1, 0, 0, 0, 1, 1], "--keep-box has to be x0 y0 z0 x1 y1 z1"),
        (["--drop-box", 0, 0, 0, 1, 1, "nan"], "--drop-box has to be"),
        (["--keep-box", 5, 5, 5, 6, 6, 6], "nothing of the model would be left"),
        (["--specks", 1.0], "--specks is 1"),
        (["--keep-at", 3, 0, 0], "there is no matter at 3 0 0"),
        (["--keep-at", 3, 0, "nan"], "--keep-at has to be three numbers"),
    ],
)
def test_bad_flags_end_in_one_sentence(call, model, tmp_path, flags, sentence, refused):
    smaller = tmp_path / "smaller.npz"
    assert sentence in refused(call(edit.main, model, "-o", smaller, *flags))
    assert not smaller.exists()


def test_no_model_is_said_so(call, tmp_path, refused):
    result = call(edit.main, tmp_path / "no.npz", "-o", tmp_path / "m.npz")
    assert "there is no model file" in refused(result)
