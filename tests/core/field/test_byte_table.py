"""A table in bytes: the same numbers, where a CPU's threads find them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from deformrf.core.base.paths import BUNDLED
from deformrf.core.field import modelfile, reached_entries, table_in_bytes
from deformrf.core.field.packing import quantize, wide_levels
from deformrf.core.render import Renderer, RenderOptions, from_field_of_view, look_at


def in_steps(field):
    """The field with a table as a file with 8 bits an entry holds it."""
    table, offsets = field.table.copy(), field.layout.offsets
    for first, end in pairwise(offsets):
        integers, scale = quantize(table[first:end])
        table[first:end] = integers * scale
    return replace(field, table=table, entry_bits=8)


@pytest.mark.parametrize("options", [{}, {"dense_levels": False}, {"level_count": 1}])
def test_words_hold_the_entries_of_nodes_and_hashes(make_ball_field, options):
    field = in_steps(make_ball_field(3, **options))
    found, layout = table_in_bytes(field.layout, field.table), field.layout
    values = found.words.astype("<i4").view(np.int8).reshape(-1, 4)
    scales = found.scales.reshape(-1, 4)
    place = 0
    for level, ids in enumerate(layout.node_ids):
        expected = field.table[layout.offsets[level] + ids.ravel()]
        part = values[place : place + ids.size] * scales[level]
        np.testing.assert_allclose(part, expected, rtol=1e-5)
        place += ids.size
    for level in range(layout.dense_level_count, layout.level_count):
        entries = np.arange(layout.offsets[level], layout.offsets[level + 1])
        part = values[found.hashed_start + entries] * scales[level]
        np.testing.assert_allclose(part, field.table[entries], rtol=1e-5)


def test_other_tables_are_not_rounded(make_ball_field):
    field = make_ball_field(3)
    assert table_in_bytes(field.layout, field.table) is None
    stepped = in_steps(field)
    table = stepped.table.copy()
    step = 0.3 * np.abs(table[:, 0]).max() / 127
    table[0, 0] += step
    assert table_in_bytes(field.layout, stepped.table).first_level == 0
    assert table_in_bytes(field.layout, table).first_level == 1
    table[-1, 0] += step
    assert table_in_bytes(field.layout, table) is None


def test_a_file_of_8_bits_has_its_coarsest_levels_in_16(make_ball_field, tmp_path):
    field = make_ball_field(3)
    modelfile.save(field, tmp_path / "m.npz", entry_bits=8)
    loaded, layout = modelfile.load(tmp_path / "m.npz"), field.layout
    reached = reached_entries(field.mesh, layout, field.occupancy)
    wide = wide_levels(layout, reached)
    end = layout.offsets[wide]
    assert 0 < wide < layout.level_count and loaded.entry_bits == 8
    assert reached[:end].sum() <= reached.sum() / 16 < reached[: layout.offsets[wide + 1]].sum()
    read = reached.nonzero()[0]
    error = np.abs(loaded.table - field.table)[read].max(axis=1)
    assert error[read < end].max() <= 2.0**-11 * np.abs(field.table[:end]).max()
    assert error[read >= end].max() > 10.0 * error[read < end].max()
    assert table_in_bytes(layout, loaded.table).first_level == wide


@pytest.mark.parametrize("name", BUNDLED)
def test_files_that_are_all_in_8_bits_stay_what_they_are(name, tmp_path):
    """Such as those of earlier versions."""
    field = modelfile.load(BUNDLED[name])
    kinds = [np.load(BUNDLED[name])[f"table_{i}"].dtype for i in range(field.layout.level_count)]
    path = modelfile.save_exactly(field, tmp_path / "m.npz")
    np.testing.assert_array_equal(modelfile.load(path).table, field.table)
    assert [np.load(path)[f"table_{i}"].dtype for i in range(len(kinds))] == kinds


@pytest.mark.parametrize("fold", [0.0, 1.0])
@pytest.mark.parametrize("level_count", [None, 1])
@pytest.mark.parametrize("deferred", [False, True])
def test_images_are_the_same_from_bytes_and_from_floats(
    make_ball_field, tmp_path, deferred, level_count, fold
):
    field = make_ball_field(3, deferred=deferred)
    modelfile.save(field, tmp_path / "m.npz", entry_bits=8)
    field = modelfile.load(tmp_path / "m.npz")
    eye = np.random.default_rng().normal(size=3)
    pose = look_at(0.5 + 1.6 * eye / np.linalg.norm(eye), (0.5, 0.5, 0.5))
    camera = from_field_of_view(pose, 0.6, 50, 40)
    options = RenderOptions(level_count=level_count, single_precision=True)
    vertices = field.mesh.rest_vertices.copy()
    vertices[0] += fold  # turns tets inside out
    images = []
    for stored_bits in (8, None):
        renderer = Renderer(replace(field, entry_bits=stored_bits), "cpu")
        assert (len(renderer.shading.on_cpu._words) > 0) == (stored_bits == 8)
        renderer.set_vertices(vertices)
        assert renderer.overlap.exists() == (fold > 0.0)
        images.append(renderer.render(camera, options).color_array().astype(int))
    assert np.ptp(images[0]) > 50
    assert np.abs(images[0] - images[1]).max() <= 1
