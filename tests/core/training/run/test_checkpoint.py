"""Checkpoint files: what can't be gone on from is one sentence."""

import resource
import signal
import struct
import zipfile
from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from deformrf.core.geometry import a15_grid
from deformrf.core.training import CheckpointError, TrainOptions, load_checkpoint, preset
from deformrf.core.training.run.checkpoint import FORMAT, Checkpoint, save_checkpoint
from deformrf.core.training.run.checkpoint_checks import OPTIONS
from deformrf.core.training.run.monitoring import MOST_ROWS


def some(**options):
    fit = {"number": 7, "parameters": [torch.arange(3.0)]}
    report = {"seconds": 1, "view_count": 3, "image_size": [16, 12]}
    return Checkpoint(preset("tiny", **options), 2, a15_grid(0.25), fit, np.eye(4), report)


def test_what_is_saved_is_loaded(tmp_path):
    saved = some(aabb=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0))
    save_checkpoint(saved, tmp_path / "a.checkpoint")
    loaded = load_checkpoint(tmp_path / "a.checkpoint")
    assert (loaded.options, loaded.stage, loaded.report) == (saved.options, 2, saved.report)
    np.testing.assert_array_equal(loaded.mesh.tets, saved.mesh.tets)
    np.testing.assert_array_equal(loaded.mesh.rest_vertices, saved.mesh.rest_vertices)
    assert torch.equal(loaded.fit["parameters"][0], torch.arange(3.0))
    assert [p.name for p in tmp_path.iterdir()] == ["a.checkpoint"]


def as_version_1_wrote_it(path, **options):
    """Give the saved options those that later versions don't have any more."""
    content = torch.load(path, weights_only=True)
    content["options"] |= {"density_layers": 1, "density_activation": "relu", **options}
    for name in ("table_decay", "color_width", "color_depth", "strong_decay", "depth_cost"):
        del content["options"][name]
    torch.save(content, path)


def test_a_checkpoint_with_options_that_are_gone_is_loaded(tmp_path):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(seed=4), path)
    as_version_1_wrote_it(path)
    known = {"table_decay": 0.0, "color_width": 64, "color_depth": 2, "leave_out": ("ray-color",)}
    assert load_checkpoint(path).options == preset("tiny", seed=4, **known)


@pytest.mark.parametrize("option", [{"density_layers": 2}, {"density_activation": "sigmoid"}])
def test_a_network_that_is_gone_is_said(tmp_path, option):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    as_version_1_wrote_it(path, **option)
    with pytest.raises(CheckpointError, match=f"{next(iter(option))}.*train it anew"):
        load_checkpoint(path)


def test_a_full_disk_is_an_error_of_the_system_and_leaves_the_older_file(tmp_path):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(seed=1), path)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))  # as if no more had room
    try:
        with pytest.raises(OSError, match=r"a\.checkpoint can't be written"):
            save_checkpoint(some(seed=2), path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert load_checkpoint(path).options.seed == 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.checkpoint"]


def truncate(path):
    path.write_bytes(path.read_bytes()[:1000])


def spoil_end(path):
    """A zip that spans several disks, which zipfile itself doesn't even want to look at."""
    content = bytearray(path.read_bytes())
    assert content[-42:-38] == b"PK\x06\x07"
    content[-26:-22] = b"\1\0\0\xff"
    path.write_bytes(content)


@pytest.mark.parametrize(
    "spoil, sentence",
    [
        (lambda path: path.unlink(), "no .* to resume from"),
        (lambda path: path.write_text("text"), "can't be read as a checkpoint"),
        (truncate, "can't be read as a checkpoint"),
        (spoil_end, "can't be read as a checkpoint"),
        (lambda path: torch.save({"format": "other"}, path), "another version"),
        (lambda path: torch.save([1], path), "no checkpoint of this version"),
        (lambda path: torch.save({"format": FORMAT}, path), "no checkpoint of this"),
    ],
)
def test_what_can_not_be_used_is_one_sentence(tmp_path, spoil, sentence):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    spoil(path)
    with pytest.raises(CheckpointError, match=sentence) as caught:
        load_checkpoint(path)
    assert "\n" not in str(caught.value)


def test_a_flipped_bit_of_any_array_is_found(tmp_path):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    whole = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        arrays = [i for i in archive.infolist() if "/data/" in i.filename and i.file_size > 8]
    assert len(arrays) >= 4
    for info in arrays:
        lengths = struct.unpack_from("<HH", whole, info.header_offset + 26)  # of name and padding
        at = info.header_offset + 30 + sum(lengths) + info.file_size // 2
        damaged = bytearray(whole)
        damaged[at] ^= 1
        path.write_bytes(damaged)
        with pytest.raises(CheckpointError, match=r"a\.checkpoint can't be read"):
            load_checkpoint(path)


@pytest.mark.parametrize(
    "changes",
    [
        {"view_count": None},
        {"view_count": "3"},
        {"image_size": 16.0},
        {"image_size": [16]},
        {"decay_gain": "much"},
        {"seconds": float("nan")},
        {"history": "all"},
        {"object_box": [[0.0] * 3] * 2},
        {"object_box": [0.0, 1.0], "object_stands": True, "object_slack": 0.1},
    ],
)
def test_a_report_that_no_run_goes_on_from_is_one_sentence(tmp_path, changes):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    content = torch.load(path, weights_only=True)
    torch.save(content | {"report": content["report"] | changes}, path)
    with pytest.raises(CheckpointError, match="no checkpoint of this version"):
        load_checkpoint(path)


@pytest.mark.parametrize(
    "forged",
    [
        {"stage": 7},
        {"mesh": [1, 2, 3]},
        {"mesh": []},
        {"report": None},
        {"world_to_model": [[1], [2, 3]]},
        {"options": {"seed": [], "aabb": 5}},
    ],
)
def test_a_forged_checkpoint_is_one_sentence(tmp_path, forged):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    torch.save(torch.load(path, weights_only=True) | forged, path)
    with pytest.raises(CheckpointError, match="no checkpoint of this version"):
        load_checkpoint(path)


def repacked(path, method):
    """The same entries, compressed."""
    with zipfile.ZipFile(path) as archive:
        entries = [(info.filename, archive.read(info)) for info in archive.infolist()]
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, content in entries:
            archive.writestr(name, content)


def test_a_small_file_takes_little_memory(tmp_path):
    """Neither what is compressed nor one number that stands for many is unpacked."""
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    content = torch.load(path, weights_only=True)
    torch.save(content | {"fit": torch.zeros(2**20)}, path)
    repacked(path, zipfile.ZIP_DEFLATED)
    with pytest.raises(CheckpointError, match="declares more than it holds"):
        load_checkpoint(path)
    torch.save(content | {"fit": torch.zeros(1).expand(2**40)}, path)
    with pytest.raises(CheckpointError, match="declare more than it holds"):
        load_checkpoint(path)


def doubled(kind):
    """A list that holds one twice, which holds one twice, and so on: 2^60 in all."""
    value = kind()
    for _ in range(60):
        value = kind((value, value))
    return value


@pytest.mark.parametrize("kind", [list, tuple])
@pytest.mark.parametrize(
    "place",
    [("report",), ("fit",), ("world_to_model",), ("mesh",), ("format",), ("stage",), ("new",)]
    + [("options", name) for name in ("seed", "aabb", "leave_out", "surroundings", "new")]
    + [("report", "seconds"), ("fit", "parameters")],
)
def test_lists_that_double_are_neither_walked_nor_printed(tmp_path, place, kind):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    content = torch.load(path, weights_only=True)
    inside = content
    for key in place[:-1]:
        inside = inside[key]
    inside[place[-1]] = doubled(kind)
    torch.save(content, path)
    with pytest.raises(CheckpointError, match="its lists and texts are longer than it holds"):
        load_checkpoint(path)


def with_pickle(path, pickled, more=()):
    """The checkpoint with another pickle in it, and with more entries."""
    with zipfile.ZipFile(path) as archive:
        entries = [(info.filename, archive.read(info)) for info in archive.infolist()]
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in entries:
            archive.writestr(name, pickled if name.endswith("data.pkl") else content)
        for name, content in more:
            archive.writestr(name, content)


DOUBLED = b")q\x01" + b"".join(b"h%c\x86q%c" % (i, i + 1) for i in range(1, 61))  # 2^60 tuples


@pytest.mark.parametrize(
    "pickled",
    [
        b"\x80\x02}" + DOUBLED + b"K\x01s.",  # {tuple: 1}
        b"\x80\x02}" + DOUBLED.replace(b"\x86q", b"\x86\x80\x02q") + b"K\x01s.",
        b"\x80\x02}" + DOUBLED + b"q\x70h\x70\x86K\x01s.",
        b"\x80\x02c__builtin__\nset\n]" + DOUBLED + b"a\x85R.",
        b"\x80\x02ccollections\nOrderedDict\n]" + DOUBLED + b"K\x01\x86a\x85R.",
        b"\x80\x02ccollections\nCounter\n]" + DOUBLED + b"a\x85R.",
        b"\x80\x02})" + b"\x85" * 500_000 + b"K\x01s.",  # a stack's end
        b"\x80\x02})" + b"\x85" * 200_000 + b"K\x01s.",
        b"\x80\x02c__builtin__\nbytearray\n\x8a\x06\0\0\0\0\0\1\x85R.",  # a tebibyte
        b"\x80\x02cos\nsystem\nX\x04\0\0\0true\x85R.",
    ],
)
def test_a_pickle_is_looked_at_before_anything_is_made_of_it(tmp_path, pickled):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    with_pickle(path, pickled)
    signal.alarm(20)  # a hash of tuples can't be interrupted: the process would end
    try:
        with pytest.raises(CheckpointError, match=r"it holds|than any checkpoint's") as caught:
            load_checkpoint(path)
    finally:
        signal.alarm(0)
    assert "weights_only" not in str(caught.value)  # torch's advice: to run what is in it


def test_a_checkpoint_with_the_longest_history_is_loaded(tmp_path):
    row = {"seconds": 1.5, "stage": 1, "step": 10**6, "psnr": 30.25}
    rows = [dict(row) for _ in range(4 * MOST_ROWS)]
    state = [torch.zeros(1) for _ in range(200)]
    saved = some()
    saved = replace(saved, report=saved.report | {"history": rows}, fit={"state": [state, state]})
    save_checkpoint(saved, tmp_path / "a.checkpoint")
    assert load_checkpoint(tmp_path / "a.checkpoint").report == saved.report


def test_an_archive_that_others_read_in_another_way_is_none(tmp_path):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    with zipfile.ZipFile(path) as archive:
        pickled = next(archive.read(name) for name in archive.namelist() if "data.pkl" in name)
    whole = path.read_bytes()
    for more in ("b/data.pkl", "b/DATA.PKL"):
        path.write_bytes(whole)
        with_pickle(path, pickled, [(more, pickled)])
        with pytest.raises(CheckpointError, match="not what torch wrote"):
            load_checkpoint(path)
    path.write_bytes(b"\x80\x02." + whole)  # torch would read its start as an older format
    with pytest.raises(CheckpointError, match="not what torch wrote"):
        load_checkpoint(path)


def test_texts_that_stand_in_many_places_count_in_each(tmp_path):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    content = torch.load(path, weights_only=True)
    content["options"]["seed"] = ["x" * 10_000] * 1000
    torch.save(content, path)
    with pytest.raises(CheckpointError, match="its lists and texts are longer than it holds"):
        load_checkpoint(path)


@pytest.mark.parametrize(
    "matrix", [[], [1, 2, 3, 4], [[1.0] * 4] * 3, [[float("nan")] * 4] * 4, [["x"] * 4] * 4, 5]
)
def test_a_transform_that_is_none_is_one_sentence(tmp_path, matrix):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    content = torch.load(path, weights_only=True)
    torch.save(content | {"world_to_model": matrix}, path)
    with pytest.raises(CheckpointError, match="no checkpoint of this version"):
        load_checkpoint(path)


@pytest.mark.parametrize(
    "name, value",
    [
        ("table_size_log2", 60),
        ("spacing", 1e-9),
        ("samples_per_step", 2**40),
        ("level_count", True),
        ("learning_rate", float("nan")),
        ("surroundings", 5),
        ("aabb", [0.0] * 5 + [float("inf")]),
        ("scene_radius", "x"),
    ],
)
def test_options_that_no_run_has_are_one_sentence(tmp_path, name, value):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    content = torch.load(path, weights_only=True)
    torch.save(content | {"options": content["options"] | {name: value}}, path)
    with pytest.raises(CheckpointError, match="no checkpoint of this version"):
        load_checkpoint(path)


def test_a_mesh_that_leads_out_of_itself_is_one_sentence(tmp_path):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    content = torch.load(path, weights_only=True)
    vertices, addresses, tets = content["mesh"]
    for mesh in (
        [vertices, addresses, tets + 10**6],
        [vertices * float("nan"), addresses, tets],
        [vertices.float(), addresses, tets],
        [vertices, addresses - 2**30, tets],
        [vertices, addresses, tets[:0]],
    ):
        torch.save(content | {"mesh": mesh}, path)
        with pytest.raises(CheckpointError, match="no checkpoint of this version"):
            load_checkpoint(path)


def test_each_option_is_checked():
    """By a bound here, or as the box and by TrainOptions itself."""
    elsewhere = {"aabb", "scene_radius", "leave_out"}
    assert {f.name for f in fields(TrainOptions)} == {*OPTIONS, *elsewhere}
