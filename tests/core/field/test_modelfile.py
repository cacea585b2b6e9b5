"""model.npz: a round trip, and one sentence for whatever is wrong with a file."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.base import paths
from deformrf.core.base.paths import ROOT
from deformrf.core.field import (
    ModelFileError,
    load,
    modelfile,
    reached_entries,
    same_values,
    save,
    save_exactly,
)
from deformrf.core.render import Renderer, from_field_of_view, look_at


@pytest.fixture
def field(make_ball_field):
    """So sparse that each level leaves entries out."""
    seed = np.random.default_rng().integers(1000)
    return make_ball_field(seed, occupied_share=0.3, level_count=3)


@pytest.fixture
def path(field, tmp_path):
    modelfile.save(field, tmp_path / "model.npz", {"note": "a test"})
    return tmp_path / "model.npz"


@pytest.mark.parametrize("bits", [8, 16])
def test_an_exact_copy_has_the_same_values(field, tmp_path, bits):
    save(field, tmp_path / "model.npz", entry_bits=bits)
    loaded = load(tmp_path / "model.npz")
    copy = load(save_exactly(loaded, tmp_path / "copy.npz"))
    assert same_values(copy, replace(loaded, entry_bits=copy.entry_bits))
    assert np.array_equal(copy.table, loaded.table)


def test_a_model_inside_another_file_is_read_from_its_bytes(path):
    content = path.read_bytes()
    loaded = load(path)
    path.write_text("another file")
    assert same_values(load(path, content), loaded)
    with pytest.raises(ModelFileError, match=r"model\.npz is not a model file"):
        load(path, content[:-100])


def test_one_bit_makes_values_differ(field):
    assert same_values(field, replace(field))
    table = field.table.copy()
    table[0, 0] = np.nextafter(table[0, 0], np.float32(9.0))
    others = {"table": table, "meta": {"size": 2.0}, "stiffness": np.ones(3), "entry_bits": 8}
    for name, value in others.items():
        assert not same_values(field, replace(field, **{name: value})), name


def rewrite(path, **changes):
    """Replace arrays of a file; None removes one, a function changes it."""
    with np.load(path) as archive:
        arrays = dict(archive)
    for name, change in changes.items():
        arrays[name] = change(arrays[name]) if callable(change) else change
    np.savez(path, **{name: a for name, a in arrays.items() if a is not None})


def rewrite_meta(path, **changes):
    def change(meta):
        values = {**json.loads(meta.tobytes()), **changes}
        return np.frombuffer(json.dumps(values).encode(), np.uint8)

    rewrite(path, meta=change)


def test_what_is_saved_is_loaded(field, path):
    loaded = modelfile.load(path)
    for name in ("rest_vertices", "addresses", "tets"):
        np.testing.assert_array_equal(getattr(loaded.mesh, name), getattr(field.mesh, name))
    np.testing.assert_array_equal(loaded.neighbours, field.neighbours)
    np.testing.assert_array_equal(loaded.occupancy, field.occupancy)
    reached = reached_entries(field.mesh, field.layout, field.occupancy)
    stored = np.where(reached[:, None], field.table.astype(np.float16), 0)
    with np.load(path) as archive:
        for level in range(field.layout.level_count):
            part = slice(*field.layout.offsets[level : level + 2])
            if f"reached_{level}" not in archive:  # its bits would take more room
                stored[part] = field.table[part].astype(np.float16)
    np.testing.assert_array_equal(loaded.table, stored)
    for ours, theirs in (
        (field.density_layers, loaded.density_layers),
        (field.color_layers, loaded.color_layers),
    ):
        for (w, b), (w2, b2) in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(w, w2)
            np.testing.assert_array_equal(b, b2)
    assert loaded.options == field.options
    assert loaded.meta["note"] == "a test"
    assert not path.with_name("model.npz.part").exists()


@pytest.mark.parametrize("entry_bits", [16, 8])
def test_saving_again_writes_the_same_tables(field, tmp_path, entry_bits):
    """Nothing drifts: what rounding leaves survives the next round trip, in as many bits.

    One byte's scale may move by a rounding, because it is found anew.
    """
    first, again = tmp_path / "first.npz", tmp_path / "again.npz"
    modelfile.save(field, first, entry_bits=entry_bits)
    loaded = modelfile.load(first)
    assert loaded.entry_bits == entry_bits
    modelfile.save(loaded, again)
    with np.load(first) as a, np.load(again) as b:
        assert a.files == b.files
        for name in a.files:
            if name.startswith("scale"):
                np.testing.assert_allclose(a[name], b[name], rtol=2e-7)
            else:
                np.testing.assert_array_equal(a[name], b[name])


def picture(field):
    view = from_field_of_view(look_at((1.6, 0.2, 0.9), (0.5, 0.5, 0.5)), 0.7, 48, 48)
    return Renderer(field).render(view).color_array()


def test_what_is_left_out_of_the_file_changes_no_pixel(field, path):
    """The table's rounding is the only difference, so round it first."""
    rounded = replace(field, table=field.table.astype(np.float16).astype(np.float32))
    with np.load(path) as archive:
        assert any(name.startswith("reached") for name in archive.files)
    np.testing.assert_array_equal(picture(modelfile.load(path)), picture(rounded))


def test_one_color_a_ray_is_read_back_and_older_versions_do_not_know_it(make_ball_field, tmp_path):
    field, path = make_ball_field(3, deferred=True, color_hidden=(256, 256)), tmp_path / "a.npz"
    modelfile.save(field, path)
    loaded = modelfile.load(path)
    assert loaded.options == field.options and loaded.options.deferred
    assert [w.shape for w, _ in loaded.color_layers] == [(32, 256), (256, 256), (256, 3)]
    for (w, b), (found, found_bias) in zip(field.color_layers, loaded.color_layers, strict=True):
        assert found.dtype == np.float32  # computed with; stored are halves
        np.testing.assert_array_equal(found, w.astype(np.float16))
        np.testing.assert_array_equal(found_bias, b)
    with np.load(path) as archive:
        arrays = dict(archive)
    meta = json.loads(arrays["meta"].tobytes()) | {"format_version": 2}
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    np.savez(path, **arrays)
    with pytest.raises(ModelFileError, match="one color a ray, which format version 2"):
        modelfile.load(path)
    del meta["options"]["deferred"]  # as version 2 is
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    for i, (weights, _) in enumerate(field.color_layers):
        arrays[f"color_weights_{i}"] = weights
    np.savez(path, **arrays)
    assert modelfile.load(path).options == replace(field.options, deferred=False)


def test_a_version_1_file_is_loaded(field, tmp_path):
    """Whole tables, every rest vertex, 32-bit integers and no word about a lattice."""
    path = tmp_path / "old.npz"
    modelfile.save(field, path)
    with np.load(path) as archive:
        arrays = {k: a for k, a in archive.items() if not k.startswith("reached")}
    meta = json.loads(arrays["meta"].tobytes()) | {"format_version": 1}
    del meta["lattice_spacing"]
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    arrays["rest_vertices"] = field.mesh.rest_vertices
    for name in ("addresses", "tets"):
        arrays[name] = getattr(field.mesh, name)
    for level in range(field.layout.level_count):
        part = field.table[slice(*field.layout.offsets[level : level + 2])]
        arrays[f"table_{level}"] = part.astype(np.float16)
    np.savez(path, **arrays)
    loaded = modelfile.load(path)
    np.testing.assert_array_equal(loaded.table, field.table.astype(np.float16))
    np.testing.assert_array_equal(loaded.mesh.rest_vertices, field.mesh.rest_vertices)


def test_the_bundled_model_is_loaded():
    field = modelfile.load(paths.DEFAULT_MODEL)
    assert field.mesh.tet_count == len(field.occupancy) > 1000
    assert np.isfinite(field.table).all()


def test_a_mesh_that_is_no_lattice_keeps_its_rest_vertices(field, tmp_path):
    moved = field.mesh.rest_vertices + np.random.default_rng().normal(
        scale=1e-4, size=field.mesh.rest_vertices.shape
    )
    mesh = replace(field.mesh, rest_vertices=moved)
    modelfile.save(replace(field, mesh=mesh), tmp_path / "moved.npz")
    loaded = modelfile.load(tmp_path / "moved.npz")
    np.testing.assert_array_equal(loaded.mesh.rest_vertices, moved)
    rewrite(tmp_path / "moved.npz", rest_vertices=set_entry(np.nan))
    with pytest.raises(ModelFileError, match="NaN"):
        modelfile.load(tmp_path / "moved.npz")


def test_a_stiffness_is_saved_and_checked(field, tmp_path):
    factors = np.geomspace(1e-2, 1e2, field.mesh.vertex_count)
    save(replace(field, stiffness=factors), tmp_path / "m.npz")
    np.testing.assert_allclose(load(tmp_path / "m.npz").stiffness, factors, rtol=1e-3)
    for wrong in (0.0, -1.0, 1e4, np.nan):
        factors[3] = wrong
        save(replace(field, stiffness=factors), tmp_path / "m.npz")
        with pytest.raises(ModelFileError, match="'stiffness'"):
            load(tmp_path / "m.npz")
    save(replace(field, stiffness=np.ones(3)), tmp_path / "m.npz")
    with pytest.raises(ModelFileError, match="'stiffness' is float16"):
        load(tmp_path / "m.npz")


def test_an_unknown_entry_size_is_refused(field, tmp_path):
    with pytest.raises(ValueError, match="4 bits"):
        modelfile.save(field, tmp_path / "m.npz", entry_bits=4)


def set_entry(value, index=0):
    def change(array):
        array = array.copy()
        array.reshape(-1)[index] = value
        return array

    return change


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"meta": None}, "no 'meta'"),
        ({"tets": None}, "'tets' is missing"),
        ({"tets": set_entry(2**16 - 1)}, "outside 0"),
        ({"tets": lambda a: a[:, [1, 0, 2, 3]]}, "rest volume"),
        ({"tets": lambda a: a.astype(np.int64)}, "int64"),
        ({"addresses": lambda a: a.astype(np.int32) - 10**5}, "addresses"),
        ({"addresses": lambda a: a[:0]}, "addresses"),
        ({"table_1": lambda a: a[:-1]}, "'table_1' holds .* but 'reached_1' marks"),
        ({"table_1": lambda a: a.astype(np.float32)}, "float16 or int8"),
        ({"table_1": lambda a: a.astype(np.int8)}, "'scale_1' is missing"),
        ({"reached_1": None}, "'table_1' holds .* but the level has"),
        ({"reached_1": lambda a: a[:-1]}, "reached_1"),
        ({"reached_1": lambda a: a.astype(np.int8)}, "reached_1"),
        ({"reached_1": lambda a: ~a}, "'reached_1' marks"),
        ({"table_2": set_entry(np.inf)}, "NaN or infinite"),
        ({"color_weights_0": lambda a: a.T}, "color_weights_0"),
        ({"occupancy": lambda a: a[1:]}, "occupancy"),
        ({"density_bias_0": np.array(["pickled", 1], object)}, "damaged"),
    ],
)
def test_damage_is_named_in_one_sentence(path, changes, words):
    rewrite(path, **changes)
    with pytest.raises(ModelFileError, match=words) as caught:
        modelfile.load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("scale", "words"),
    [(np.nan, "NaN"), (-1.0, "leaves 0"), (1e30, "leaves 0"), (None, "missing")],
)
def test_a_damaged_scale_is_named_in_one_sentence(field, tmp_path, scale, words):
    path = tmp_path / "m.npz"
    modelfile.save(field, path, entry_bits=8)
    rewrite(path, scale_2=None if scale is None else set_entry(scale))
    with pytest.raises(ModelFileError, match=words):
        modelfile.load(path)


def test_bits_beyond_the_last_entry_are_refused(path, field):
    count = field.layout.entry_counts[1]
    assert count % 8 > 0
    rewrite(path, reached_1=lambda bits: np.append(bits[:-1], np.uint8(255)))
    with pytest.raises(ModelFileError, match=f"beyond the level's {count}"):
        modelfile.load(path)


def test_a_field_without_dense_levels_is_loaded(make_ball_field, tmp_path):
    field = make_ball_field(3, occupied_share=1.0, level_count=3, dense_levels=False)
    path = tmp_path / "hashed.npz"
    modelfile.save(field, path)
    loaded = modelfile.load(path)
    assert loaded.options == field.options
    assert loaded.layout.entry_counts == (field.options.table_size,) * 3
    reached = reached_entries(field.mesh, field.layout, field.occupancy)
    assert 0 < reached[: field.options.table_size].sum() <= field.mesh.vertex_count  # level 0
    stored = field.table[reached].astype(np.float16)
    np.testing.assert_array_equal(loaded.table[reached], stored)


def test_a_file_that_says_nothing_of_dense_levels_has_them(path, field):
    with np.load(path) as archive:
        options = json.loads(archive["meta"].tobytes())["options"]
    del options["dense_levels"]
    rewrite_meta(path, options=options)
    loaded = modelfile.load(path)
    assert loaded.options.dense_levels
    assert loaded.layout.entry_counts == field.layout.entry_counts


def test_a_project_is_named_as_one(path):
    project = path.rename(path.with_suffix(".deformrf"))
    with pytest.raises(ModelFileError, match="it is a project, which only `view`"):
        modelfile.load(project)
    modelfile.load(project, project.read_bytes())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format_version": 99}, "version 99"),
        ({"format": "something"}, "not a deformrf model"),
        ({"options": {}}, "entries|damaged|table|weights"),
        ({"entry_counts": [1, 2]}, "declares"),
        ({"feature_count": 8}, "8 features"),
        ({"dense_level_count": 0}, "0 of them dense"),
        ({"world_to_model": [1.0]}, "4x4"),
        ({"lattice_spacing": 0.0}, "spacing is 0.0"),
        ({"lattice_spacing": float("nan")}, "spacing is nan"),
        ({"lattice_spacing": "wide"}, "damaged"),
        ({"lattice_spacing": None}, "'rest_vertices' is missing"),
        ({"lattice_spacing": [[0.1]]}, "damaged"),
        ({"world_to_model": [[10**400] * 4] * 4}, "damaged"),
        ({"world_to_model": {"a": None}}, "damaged"),
        ({"entry_counts": ["many\nlines"] * 200}, "declares"),
        ({"format_version": "2\nlines"}, "version 2 lines"),
        ({"options": None}, "damaged"),
        ({"options": [1, 2]}, "damaged"),
    ],
)
def test_wrong_metadata_is_named_in_one_sentence(path, changes, words):
    rewrite_meta(path, **changes)
    with pytest.raises(ModelFileError, match=words) as caught:
        modelfile.load(path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 600


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"density_activation": "sigmoid"}, "activation 'sigmoid', this program reads relu"),
        ({"density_activation": None}, "activation 'None'"),
        ({"level_count": 0}, "0 levels, not 1 to 10"),
        ({"level_count": -(10**30)}, "levels, not 1 to 10"),
        ({"level_count": 3.0}, "'level_count' is 3.0"),
        ({"table_size": 2**70}, "more than"),
        ({"table_size": "large"}, "'table_size' is 'large'"),
        ({"view_dependence": 1}, "'view_dependence' is 1"),
        ({"density_hidden": 64}, "damaged"),
        ({"density_hidden": [64, 64]}, "density_weights_1"),
        ({"color_hidden": {"64": 64}}, "hidden layers"),
        ({"march_step": 1e-9}, "march step is 1e-09"),
        ({"march_step": [0.01]}, "damaged"),
        ({"march_step": float("nan")}, "march step is nan"),
        ({"later_option": 1}, "later_option"),
        ({"color_hidden": [20_000, 20_000]}, "400700000 weights, more than"),
        ({"density_hidden": [1] * 9}, "hidden layers"),
        ({"table_size": 2**40}, "more than"),
    ],
)
def test_a_wrong_option_is_named_in_one_sentence(path, changes, words):
    with np.load(path) as archive:
        options = json.loads(archive["meta"].tobytes())["options"]
    rewrite_meta(path, options=options | changes)
    with pytest.raises(ModelFileError, match=words) as caught:
        modelfile.load(path)
    assert "\n" not in str(caught.value)


def test_meta_that_nests_deeply_is_refused(path):
    nested = b"[" * 20_000 + b"]" * 20_000
    rewrite(path, meta=np.frombuffer(nested, np.uint8))
    with pytest.raises(ModelFileError, match="nests too deeply"):
        modelfile.load(path)


def test_a_training_entry_without_a_documented_type_is_dropped(path):
    row = {"seconds": 2.0, "stage": 1, "step": 16, "psnr": 12.5}
    rows = [row, row | {"stage": 3}, row | {"psnr": "high"}, row | {"seconds": 0}, 7]
    known = {"note": [1], "data": "chair", "seconds": 3, "peak_memory_bytes": [1, 2.5]}
    known |= {"interrupted": False, "tet_count": 9, "image_size": [40, 30], "occupied_share": 0.5}
    wrong = {"device": 7, "workers": 1.5, "stage_1_seconds": "short", "options": None}
    wrong |= {"missing_images": True, "stage_1_tet_count": 2.5, "levels_left_out": "2"}
    scores = {"psnr": 30.5, "lpips": None, "ssim": float("nan")}
    rewrite_meta(path, training={**known, **wrong, "history": rows, "test_mean": scores})
    expected = {**known, "history": [row], "test_mean": {"psnr": 30.5}}
    assert modelfile.load(path).meta == expected
    rewrite_meta(path, training={"device": "a\x1b[31m\nb"})
    assert modelfile.load(path).meta == {"device": "a\\x1b[31m\\nb"}
    long = "a" * (modelfile.LONGEST_LINE + 1)
    rewrite_meta(path, training={"attribution": long})
    assert modelfile.load(path).attribution == long[:-1]
    for value in (None, 7, "text", [known]):
        rewrite_meta(path, training=value)
        assert modelfile.load(path).meta == {}


@pytest.mark.parametrize(
    "key, value",
    [
        ("image_size", 40),
        ("image_size", ["wide", "high"]),
        ("views", [[0.5] * 16, [0.5] * 15]),
        ("views", [[0.5] * 15 + ["up"]]),
        ("missing_images", 1.5),
        ("interrupted", 1),
        ("occupied_share", "half"),
        ("tet_count", 1.5),
        ("stage_1_tet_count", None),
        ("test_angles", {"median": 3.0}),
        ("test_angles", {"median": 3.0, "largest": "far"}),
        ("sector", ["r_0.png"]),
        ("sector_scores", [1.0]),
        ("sector_scores", {"held_out": {"view_count": 3, "mean": {}}}),
        ("sector_scores", {"held_out": {"view_count": 3, "mean": {"psnr": []}, "angles": None}}),
    ],
)
def test_every_key_of_the_documented_training_entry_has_its_type(path, key, value):
    rewrite_meta(path, training={"data": "chair", key: value})
    assert modelfile.load(path).meta == {"data": "chair"}


def test_every_documented_key_of_the_training_entry_has_a_type():
    text = (ROOT / "docs/model-format.md").read_text()
    table = text.split("### `training`")[1].split("\n## ")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    documented = {key for row in rows for key in re.findall("`(.*?)`", row)}
    assert documented == modelfile.TRAINING.keys()


def test_older_programs_can_read_the_options_that_are_written(path):
    with np.load(path) as archive:
        options = json.loads(archive["meta"].tobytes())["options"]
    assert options["density_activation"] == "relu"
    assert options["density_hidden"] == [64] and options["color_hidden"] == [64, 64]


def test_a_failed_save_leaves_nothing_behind(field, tmp_path, monkeypatch):
    def no_space(*_, **__):
        raise OSError("no space left")

    monkeypatch.setattr(np, "savez_compressed", no_space)
    with pytest.raises(OSError, match="no space"):
        modelfile.save(field, tmp_path / "model.npz")
    assert not list(tmp_path.iterdir())
