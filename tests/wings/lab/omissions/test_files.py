"""What a model file leaves out: by the sizes of files that are written."""

import json
from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.field import modelfile
from deformrf.wings.lab.omissions.files import file_rows
from deformrf.wings.lab.omissions.frames import Frames
from deformrf.wings.lab.omissions.measure import NONE, NOT_MEASURED, SAVES


@pytest.fixture
def rows(tmp_path):
    def rows(field, path=None, **settings):
        path = path or tmp_path / "model.npz"
        if not path.exists():
            modelfile.save(field, path, **settings)
        return {row.name: row for row in file_rows(Frames(field, "cpu", 24, 2), path)}, path

    return rows


@pytest.mark.parametrize("entry_bits", [8, 16])
def test_what_nothing_reaches_is_left_out(make_ball_field, rows, entry_bits):
    field = make_ball_field(4, occupied_share=0.2, level_count=3)
    found, path = rows(field, entry_bits=entry_bits)
    entries = found["table entries that no occupied sub-tet reaches"]
    assert entries.left_out and entries.verdict == SAVES
    assert entries.change == NONE  # with noise in all of them
    assert entries.without.median == pytest.approx(path.stat().st_size / 1e6, rel=0.02)
    vertices = found["rest vertices of a lattice"]
    assert vertices.left_out and vertices.change == NONE and vertices.unit == "MB"
    stored = 24e-6 * field.mesh.vertex_count  # before the file is deflated
    assert 0.05 * stored < vertices.saving.median < stored + 5e-4


def test_where_all_is_reached_nothing_is_saved(ball, rows):
    row = rows(ball)[0]["table entries that no occupied sub-tet reaches"]
    assert row.left_out and row.saving.median >= 0.0 and row.change == NONE


def test_vertices_of_no_lattice_are_stored(make_ball_field, rows):
    field = make_ball_field(4)
    rest = field.mesh.rest_vertices + 1e-3 * np.random.default_rng().normal(size=3)
    rest[0] += 1e-3
    field = replace(field, mesh=replace(field.mesh, rest_vertices=rest))
    row = rows(field)[0]["rest vertices of a lattice"]
    assert row.verdict == NOT_MEASURED and not row.left_out and row.saving is None


def test_an_older_file_has_what_this_program_leaves_out(ball, rows, tmp_path):
    arrays = modelfile.pack(ball) | {"rest_vertices": ball.mesh.rest_vertices}
    meta = json.loads(arrays["meta"].tobytes()) | {"format_version": 1, "lattice_spacing": None}
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    path = tmp_path / "older.npz"
    np.savez(path, **arrays)
    found, _ = rows(modelfile.load(path), path)
    assert len(found) == 2 and not any(row.left_out for row in found.values())
    assert found["rest vertices of a lattice"].verdict == SAVES
