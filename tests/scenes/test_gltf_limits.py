"""glTF files that share and multiply: read once, bounded before memory is taken, or refused."""

import copy
import json

import numpy as np
import pytest
from gltf_files import make_bar
from peak_memory import peak_memory

from deformrf.wings.rig import read_gltf
from deformrf.wings.rig.gltf_file import MOST_NUMBERS
from deformrf.wings.rig.gltf_nodes import MOST_NODES

MOST_MEMORY = 250e6  # bytes that Python and NumPy may take for any of these files


@pytest.fixture
def bar():
    return make_bar(np.random.default_rng())[0]


@pytest.fixture
def read(tmp_path):
    """A function that saves a file and reads it."""

    def save_and_read(file):
        file.save(tmp_path / "bar.glb")
        return read_gltf(tmp_path / "bar.glb")

    return save_and_read


def refused(read, bar, words):
    """That a file is refused with these words, in little memory."""

    def once():
        with pytest.raises(ValueError, match=words):
            read(bar)

    assert peak_memory(once) < MOST_MEMORY


def many_clips(file, count, key_count):
    """So many clips that turn one bone, all by the same keys."""
    rng = np.random.default_rng()
    times = file.add(np.linspace(0.0, 1.0, key_count).astype("<f4"), "SCALAR")
    keys = file.add(rng.normal(size=(key_count, 4)).astype("<f4"), "VEC4")
    file.parts["animations"] = [
        {
            "name": "Turn",
            "channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}],
            "samplers": [{"input": times, "output": keys}],
        }
    ] * count


def test_clips_that_share_keys_are_the_same(bar, read):
    many_clips(bar, 50, 100)
    rig = read(bar)
    assert [clip.name for clip in rig.clips[:3]] == ["Turn", "Turn.001", "Turn.002"]
    assert len({clip.name for clip in rig.clips}) == 50
    first = rig.clips[0].matrices_at(rig.skeleton, 0.37)
    np.testing.assert_array_equal(rig.clips[-1].matrices_at(rig.skeleton, 0.37), first)


def test_keys_that_many_channels_share_have_a_limit_in_all(bar, read):
    many_clips(bar, 1000, 100_000)
    sentence = "numbers in their keys; export fewer clips or keys"
    refused(read, bar, sentence)


def test_a_clip_that_moves_a_bone_again_and_again_is_refused_before_its_keys_are_made(bar, read):
    """32,768 channels are allowed, and each takes its time."""
    many_clips(bar, 1, 3)
    animation = bar.parts["animations"][0]
    animation["channels"] *= 50_000
    animation["samplers"][0]["output"] = 10**6  # it isn't there: whoever reads keys would say so
    with pytest.raises(ValueError, match=r"clip 'Turn' animates a bone's .* twice"):
        read(bar)


def test_clips_have_a_limit(bar, read):
    many_clips(bar, 1001, 1)
    with pytest.raises(ValueError, match="it has 1001 clips, over 1000"):
        read(bar)


def chained(file, count, node=None):
    """Put so many nodes above the bar's, each the child of the one before."""
    nodes = file.parts["nodes"]
    first = len(nodes)
    chain = [{**(node or {}), "children": [first + i + 1]} for i in range(count)]
    chain[-1]["children"] = [0]
    nodes += chain


def test_a_chain_of_nodes_is_multiplied_out(bar, read):
    plain = read(copy.deepcopy(bar))
    chained(bar, MOST_NODES - 5, {"translation": [0.0, 0.0, 0.25]})
    rig = read(bar)
    shift = [0.0, -0.25 * (MOST_NODES - 5), 0.0]
    np.testing.assert_allclose(rig.skeleton.heads, plain.skeleton.heads + shift, atol=1e-6)
    np.testing.assert_allclose(rig.points, plain.points + shift, atol=1e-6)


def test_a_chain_of_bones_and_nodes_is_multiplied_out(bar, read):
    """Bones that clips move, far from each other in the chain of all nodes."""
    count = 40_000
    chained(bar, count, {"matrix": np.eye(4).ravel().tolist()})
    every = list(range(5, 5 + count, count // 1000))[:1000]
    target = bar.parts["animations"][0]["channels"][0]
    channel = [{**target, "target": {"node": node, "path": "rotation"}} for node in every]
    bar.parts["animations"][0]["channels"] = channel
    rig = read(bar)
    assert rig.skeleton.bone_count == 1002
    assert np.count_nonzero(rig.skeleton.parents < 0) == 1
    assert len(rig.clips[0].channels) >= 1000


@pytest.mark.filterwarnings("error")
def test_a_chain_that_grows_without_end_is_refused(bar, read):
    chained(bar, 2000, {"scale": [10.0] * 3})
    with pytest.raises(ValueError, match="is no finite 4×4 matrix"):
        read(bar)


def test_a_mesh_that_many_nodes_draw_is_read_once(bar, read):
    bar.parts["nodes"] += [{"mesh": 0, "skin": 0}] * 5000
    rig = read(bar)
    assert rig.points.shape == (12, 3) and rig.notes == ()


def test_points_and_triangles_that_many_meshes_share_have_limits(bar, read):
    primitive = bar.parts["meshes"][0]["primitives"][0]
    for count, sentence in ((5000, "5000 meshes or materials"), (30_000, "360000 points")):
        bar.parts["meshes"][0]["primitives"] = [primitive] * count
        with pytest.raises(ValueError, match=f"its skin has {sentence}"):
            read(bar)
    wide = bar.add(np.zeros(300_000, "<u2"), "SCALAR")
    bar.parts["meshes"][0]["primitives"] = [primitive | {"indices": wide}] * 100
    refused(read, bar, "its skin has 10000000 triangles")


def test_points_times_bones_have_a_limit(bar, read):
    first = len(bar.parts["nodes"])
    bar.parts["nodes"] += [{"name": "more"}] * 1000
    bar.parts["skins"][0] = {"joints": [1, 3, *range(first, first + 1000)]}
    attributes = {
        "POSITION": bar.add(np.ones((60_000, 3), "<f4"), "VEC3"),
        "JOINTS_0": bar.add(np.zeros((60_000, 4), "<u2"), "VEC4"),
        "WEIGHTS_0": bar.add(np.tile(np.float32([1, 0, 0, 0]), (60_000, 1)), "VEC4"),
    }
    bar.parts["meshes"][0]["primitives"] = [{"attributes": attributes}]
    sentence = "60000 points and 1002 bones; simplify it"
    refused(read, bar, sentence)


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("[" * 10**6, "JSON can't be read"),
        ('{"a":' * 10**5, "JSON can't be read"),
        ('{"asset": {"version": 1' + "0" * 5000 + "}}", "JSON can't be read"),
        ('{"asset": {"version": "2.0"}, "nodes": [' + "{}," * 10**6 + "{}]}", "more than 1048576"),
        ('{"asset": 5}', "it is glTF None"),
        ('{"asset": {"version": "2.0"}, "nodes": {"a": 1}}', "its nodes are no list"),
        ('{"asset": {"version": "2.0"}, "nodes": [1, 2]}', "its nodes are no list"),
    ],
)
def test_json_that_is_deep_or_long_is_one_sentence(tmp_path, text, sentence):
    path = tmp_path / "bad.gltf"
    path.write_text(text)
    with pytest.raises(ValueError, match=sentence) as caught:
        read_gltf(path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400 + len(str(path))


def test_numbers_as_large_as_they_like_are_one_sentence(bar, read):
    for place in (
        ("accessors", 0, "count"),
        ("bufferViews", 0, "byteLength"),
        ("nodes", 0, "scale"),
    ):
        file = copy.deepcopy(bar)
        file.parts[place[0]][place[1]][place[2]] = 10**4000
        with pytest.raises(ValueError) as caught:
            read(file)
        assert len(str(caught.value)) < 500


def as_sparse(file, accessor, start, places, kind="<u2"):
    """Store an accessor's values as those of `start` (None: zeros) with some that differ."""
    entry = file.parts["accessors"][accessor]
    view = file.parts["bufferViews"][entry["bufferView"]]
    data = file.blob[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    values = np.frombuffer(data, "<f4").reshape(entry["count"], -1)
    indices = file.add(np.asarray(places, kind), "SCALAR")
    changes = file.add(values[places], entry["type"])
    views = [file.parts["accessors"][k]["bufferView"] for k in (indices, changes)]
    del entry["bufferView"]
    if start is not None:
        base = file.add(start.astype("<f4"), entry["type"])
        entry["bufferView"] = file.parts["accessors"][base]["bufferView"]
    entry["sparse"] = {
        "count": len(places),
        "indices": {"bufferView": views[0], "componentType": 5123},
        "values": {"bufferView": views[1]},
    }
    return values


@pytest.mark.parametrize("based", [True, False])
def test_sparse_points_are_those_that_are_stored_in_full(bar, read, based):
    wanted = read(copy.deepcopy(bar)).points
    places = np.arange(12) if not based else np.array([1, 4, 11])
    start = None
    if based:
        view = bar.parts["bufferViews"][0]
        start = np.frombuffer(bar.blob[: view["byteLength"]], "<f4").reshape(12, 3).copy()
        start[places] = 7.0
    as_sparse(bar, 0, start, places)
    np.testing.assert_array_equal(read(bar).points, wanted)


def test_sparse_values_without_any_others_are_zeros_elsewhere(bar, read):
    as_sparse(bar, 0, None, np.array([2, 5]))
    same = np.delete(read(bar).points, [2, 5], axis=0)
    np.testing.assert_array_equal(same, np.tile(same[:1], (10, 1)))


@pytest.mark.parametrize(
    "change, sentence",
    [
        ({"count": 13}, "sparse points are 13 of 12"),
        ({"count": 0}, "sparse points are 0 of 12"),
        ({"count": 10**4000}, "sparse points are"),
        ({"indices": None}, "lack their indices or values"),
        ({"indices": {"bufferView": 99, "componentType": 5123}}, "in buffer view 99"),
        ({"indices": {"bufferView": 0, "componentType": 5126}}, "indices that are no whole"),
        ({"values": {"bufferView": 0, "byteOffset": 10**6}}, "sparse points need"),
    ],
)
def test_bad_sparse_points_are_one_sentence(bar, read, change, sentence):
    as_sparse(bar, 0, None, np.array([2, 5]))
    bar.parts["accessors"][0]["sparse"] |= change
    with pytest.raises(ValueError, match=sentence) as caught:
        read(bar)
    assert len(str(caught.value)) < 500


def test_a_sparse_index_out_of_bounds_is_said_so(bar, read):
    as_sparse(bar, 0, None, np.array([2, 5]))
    view = bar.parts["accessors"][0]["sparse"]["indices"]["bufferView"]
    first = bar.parts["bufferViews"][view]["byteOffset"]
    bar.blob = bar.blob[:first] + np.uint16(60000).tobytes() + bar.blob[first + 2 :]
    with pytest.raises(ValueError, match="sparse points change value 60000 of 12"):
        read(bar)


def test_sparse_values_that_a_few_bytes_declare_are_counted(bar, read):
    """No byte of the file stands for these zeros."""
    few = bar.add(np.zeros(1, "<u2"), "SCALAR"), bar.add(np.ones((1, 4), "<f4"), "VEC4")
    views = [bar.parts["accessors"][k]["bufferView"] for k in few]
    sparse = {
        "count": 1,
        "indices": {"bufferView": views[0], "componentType": 5123},
        "values": {"bufferView": views[1]},
    }
    entry = {"componentType": 5126, "count": MOST_NUMBERS, "type": "VEC4", "sparse": sparse}
    bar.parts["animations"][0]["samplers"][0]["output"] = len(bar.parts["accessors"])
    bar.parts["accessors"] += [entry]
    sentence = "more than 8388608 numbers; export fewer parts or clips"
    refused(read, bar, sentence)


def test_other_skins_are_told(bar, read):
    plain = read(copy.deepcopy(bar))
    bar.parts["skins"] = [{"joints": [1]}, bar.parts["skins"][0] | {"name": "Body"}]
    few = {"POSITION": bar.add(np.ones((3, 3), "<f4"), "VEC3")}
    bar.parts["meshes"] += [{"primitives": [{"attributes": few}]}]
    bar.parts["nodes"][4]["skin"] = 1
    bar.parts["nodes"] += [{"mesh": 1, "skin": 0}]
    rig = read(bar)
    np.testing.assert_array_equal(rig.points, plain.points)
    assert len(rig.notes) == 1 and "2 skins: Body, with the most points (12)" in rig.notes[0]


@pytest.mark.parametrize(
    "place, weights, sentence",
    [
        ("meshes", [0.0, 0.5], "with weights up to 0.5 at rest"),
        ("nodes", [0.25], "with weights up to 0.25 at rest"),
        ("meshes", [0.0, 0.0], None),
        ("animations", None, "that 1 of its clips move"),
    ],
)
def test_morph_targets_that_show_are_told(bar, read, place, weights, sentence):
    if place == "animations":
        target = {"sampler": 0, "target": {"node": 4, "path": "weights"}}
        bar.parts["animations"][0]["channels"] += [target]
    else:
        bar.parts[place][4 if place == "nodes" else 0]["weights"] = weights
    notes = read(bar).notes
    assert len(notes) == (sentence is not None)
    assert sentence is None or sentence in notes[0]


def test_a_file_as_text_is_read_as_one_of_bytes(bar, read, tmp_path):
    import base64

    wanted = read(copy.deepcopy(bar))
    uri = "data:application/octet-stream;base64," + base64.b64encode(bar.blob).decode()
    bar.parts["buffers"] = [{"byteLength": len(bar.blob), "uri": uri}]
    (tmp_path / "bar.gltf").write_text(json.dumps(bar.parts), encoding="utf-8-sig")
    np.testing.assert_array_equal(read_gltf(tmp_path / "bar.gltf").points, wanted.points)
