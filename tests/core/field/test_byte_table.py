"""A table in bytes: the same numbers, where a CPU's threads find them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from deformrf.core.field import modelfile, table_in_bytes
from deformrf.core.field.packing import quantize
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
    table[0, 0] += 0.3 * np.abs(table[:, 0]).max() / 127
    assert table_in_bytes(field.layout, stepped.table) is not None
    assert table_in_bytes(field.layout, table) is None


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
