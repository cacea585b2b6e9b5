"""glTF: our skinning is the file's own, whatever its nodes do; what is no rig is one sentence."""

import json
import struct

import numpy as np
import pytest
from gltf_files import TIMES, make_bar

from deformrf.wings.rig import Channel, aligned, read_gltf, rotations, scale_of, skinned
from deformrf.wings.rig.clips import interpolated

Y_UP_TO_Z_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])


def by_definition(file, seconds):
    """The points of the bar as glTF defines them: the nodes multiplied out.  [12, 3]"""
    parts, points, weights, inverse = file
    blob, accessors, views = parts.blob, parts.parts["accessors"], parts.parts["bufferViews"]

    def numbers(index, width):
        view = views[accessors[index]["bufferView"]]
        data = blob[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        return np.frombuffer(data, "<f4").reshape(-1, width).astype(float)

    animation = parts.parts["animations"][0]
    values = {}
    for channel in animation["channels"]:
        target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
        keys = numbers(sampler["output"], 4 if target["path"] == "rotation" else 3)
        kind = sampler["interpolation"]
        keys = keys.reshape(3, 3, -1) if kind == "CUBICSPLINE" else keys
        one = Channel(0, target["path"], kind, TIMES.astype(float), keys)
        values[target["node"], target["path"]] = interpolated(one, keys, seconds)

    def local(node):
        given = parts.parts["nodes"][node]
        defaults = ("translation", [0, 0, 0]), ("rotation", [0, 0, 0, 1]), ("scale", [1, 1, 1])
        shift, turn, scale = (values.get((node, p), given.get(p, d)) for p, d in defaults)
        matrix = np.eye(4)
        matrix[:3, :3] = rotations.matrix_of(rotations.unit(turn)) * np.asarray(scale)
        matrix[:3, 3] = shift
        return matrix

    lower = local(0) @ local(3)
    upper = lower @ local(2) @ local(1)
    matrices = np.array([upper @ inverse[0], lower @ inverse[1]])
    return skinned(points, weights[:, :2], matrices) @ Y_UP_TO_Z_UP.T


@pytest.fixture
def bar():
    return make_bar(np.random.default_rng())


@pytest.mark.parametrize("seconds", [0.0, 0.25, 0.4, 1.0, 1.5, 3.0])
def test_the_points_move_as_the_file_says(bar, tmp_path, seconds):
    bar[0].save(tmp_path / "bar.glb")
    rig = read_gltf(tmp_path / "bar.glb")
    assert rig.skeleton.names == ("lower", "upper") and rig.triangles.shape == (4, 3)
    (clip,) = rig.clips
    assert (clip.name, clip.duration) == ("Wave", 1.5)
    moved = skinned(rig.points, rig.point_weights, clip.matrices_at(rig.skeleton, seconds))
    np.testing.assert_allclose(moved, by_definition(bar, seconds), atol=1e-5)


def test_another_space_moves_everything_alike(bar, tmp_path):
    bar[0].save(tmp_path / "bar.glb")
    rig = read_gltf(tmp_path / "bar.glb")
    matrix = np.eye(4)
    matrix[:3, :3] = 0.3 * rotations.matrix_of(rotations.of_vector([0.4, -1.0, 0.2]))
    matrix[:3, 3] = [1.0, 2.0, 3.0]
    there = aligned(rig, matrix)
    for seconds in (0.0, 0.4, 1.2):
        moved = skinned(
            rig.points, rig.point_weights, rig.clips[0].matrices_at(rig.skeleton, seconds)
        )
        wanted = moved @ matrix[:3, :3].T + matrix[:3, 3]
        matrices = there.clips[0].matrices_at(there.skeleton, seconds)
        found = skinned(there.points, there.point_weights, matrices)
        np.testing.assert_allclose(found, wanted, atol=1e-9)
    np.testing.assert_allclose(
        there.skeleton.tails, rig.skeleton.tails @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-9
    )


@pytest.mark.parametrize("change", ["mirror", "stretch", "nan", "row"])
def test_only_similarities_place_a_rig(change):
    matrix = np.eye(4)
    place = {"mirror": (0, 0), "stretch": (0, 0), "nan": (1, 1), "row": (3, 0)}[change]
    matrix[place] = {"mirror": -1.0, "stretch": 1.5, "nan": np.nan, "row": 0.1}[change]
    with pytest.raises(ValueError, match="the matrix"):
        scale_of(matrix, "the matrix")


def test_the_fox_moves_as_in_blender(shared_data):
    """Blender mixes quaternions on a chord between keys: it is up to 2e-3 off there."""
    truth = json.loads((shared_data("foxrig") / "rig.json").read_text())
    meta = json.loads((shared_data("foxrig") / "render_meta.json").read_text())
    matrix = np.diag([meta["scale"]] * 3 + [1.0])
    matrix[:3, 3] = -meta["scale"] * np.array(meta["centre"])
    fox = aligned(read_gltf(shared_data("rigs") / "Fox.glb"), matrix)
    assert [clip.name for clip in fox.clips] == ["Survey", "Walk", "Run"]
    heads = {bone["name"]: bone["head"] for bone in truth["bones"]}
    wanted = [heads[name] for name in fox.skeleton.names]
    np.testing.assert_allclose(fox.skeleton.heads, wanted, atol=1e-6)
    for name, limit in (("Survey", 1e-5), ("Run", 2e-3)):
        clip = next(clip for clip in fox.clips if clip.name == name)
        for sample in truth["clips"][name]["samples"]:
            wanted = [sample["skinning_matrices"][bone] for bone in fox.skeleton.names]
            found = clip.matrices_at(fox.skeleton, sample["time"])
            np.testing.assert_allclose(found, wanted, atol=limit)


def in_parts(*path, value):
    def change(file):
        place = file.parts
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value

    return change


ATTRIBUTES = ("meshes", 0, "primitives", 0, "attributes")


@pytest.mark.parametrize(
    "change, sentence",
    [
        (in_parts("asset", "version", value="1.0"), "it is glTF 1.0"),
        (in_parts("skins", 0, "joints", value=[1, 99]), "joints are in node 99, of 5"),
        (in_parts("skins", 0, "joints", value=[1]), "points are bound to joint 1"),
        (in_parts("skins", 0, "joints", value=[1, 1]), "names a joint twice"),
        (in_parts("skins", 0, "joints", value=[-1, 3]), "in node -1"),
        (in_parts("skins", value=[]), "bones are in skin 0, of 0"),
        (in_parts("nodes", 4, value={"name": "no skin"}), "no mesh that is bound to bones"),
        (in_parts("nodes", 1, "children", value=[3]), "has two parents"),
        (in_parts("nodes", 1, "children", value=[0]), "its own ancestor"),
        (in_parts("nodes", 3, "children", value=[2, 77]), "in node 77"),
        (in_parts("nodes", 3, "translation", value=[0, float("nan"), 0]), "holds NaN"),
        (in_parts("nodes", 2, "scale", value=[1, 2, 1]), "scales unevenly or shears"),
        (in_parts("nodes", 2, "scale", value=[0, 0, 0]), "flattens"),
        (in_parts("accessors", 0, "count", value=10**5), "points need"),
        (in_parts("accessors", 0, "count", value=10**6), "its skin has 1000000 points"),
        (in_parts("accessors", 0, "count", value=-5), "which is no number of values"),
        (in_parts("accessors", 0, "type", value="VEC2"), "the type VEC2, not VEC3"),
        (in_parts("accessors", 0, "bufferView", value=999), "in buffer view 999"),
        (in_parts("accessors", 0, "sparse", value={"count": 1}), "lack their indices or values"),
        (in_parts("bufferViews", 0, "byteOffset", value=10**7), "outside of the file"),
        (in_parts("bufferViews", 0, "byteLength", value=10**9), "outside of the file"),
        (in_parts("bufferViews", 0, "byteStride", value=3), "points need"),
        (in_parts(*ATTRIBUTES, "WEIGHTS_0", value=None), "weights of points are in accessor None"),
        (in_parts(*ATTRIBUTES, "WEIGHTS_0", value=0), "weights of points have the type VEC3"),
        (
            in_parts("extensionsRequired", value=["KHR_draco_mesh_compression"]),
            "needs the glTF ext",
        ),
        (in_parts("buffers", value=[{"uri": "../../etc/passwd"}]), "in another file"),
        (in_parts("buffers", value=[{"uri": "https://a.b/c.bin"}]), "in another file"),
        (in_parts("buffers", value=[]), "of 0"),
    ],
)
def test_bad_files_end_in_one_sentence(bar, tmp_path, change, sentence):
    path = tmp_path / "bad.glb"
    change(bar[0])
    bar[0].save(path)
    with pytest.raises(ValueError, match=sentence) as caught:
        read_gltf(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.filterwarnings("error")
def test_a_signaling_nan_is_refused_without_a_line_of_numpys(tmp_path):
    file, points, _, _ = make_bar(np.random.default_rng())
    place = file.blob.index(np.float32(points).tobytes())
    file.blob = file.blob[:place] + struct.pack("<I", 0x7F800001) + file.blob[place + 4 :]
    file.save(tmp_path / "bad.glb")
    with pytest.raises(ValueError, match="points hold NaN or infinite numbers"):
        read_gltf(tmp_path / "bad.glb")


def test_weights_that_do_not_sum_to_one_are_said_so(tmp_path):
    file, _, weights, _ = make_bar(np.random.default_rng())
    place = file.blob.index(weights.tobytes())
    file.blob = file.blob[:place] + (0.5 * weights).tobytes() + file.blob[place + weights.nbytes :]
    file.save(tmp_path / "bad.glb")
    with pytest.raises(ValueError, match=r"the weights of point 0 sum to 0\.5, not 1"):
        read_gltf(tmp_path / "bad.glb")


def test_what_a_sentence_quotes_is_in_one_line(bar, tmp_path):
    bar[0].parts["skins"][0]["inverseBindMatrices"] = "a\n\x1b[31mb"
    bar[0].save(tmp_path / "bad.glb")
    with pytest.raises(ValueError, match="bind matrices are in accessor") as caught:
        read_gltf(tmp_path / "bad.glb")
    assert str(caught.value).isprintable()


def test_damaged_files_end_in_one_sentence(bar, tmp_path):
    path = tmp_path / "bar.glb"
    bar[0].save(path)
    whole, rng = path.read_bytes(), np.random.default_rng()
    length = struct.unpack("<I", whole[12:16])[0]
    for _ in range(150):
        damaged = bytearray(whole)
        for place in rng.integers(0, 20 + length, 2):
            damaged[place] = rng.integers(32, 127)
        path.write_bytes(damaged[: rng.integers(len(whole) // 2, len(whole) + 1)])
        try:
            read_gltf(path)
        except ValueError as error:
            assert "\n" not in str(error)
    for content in (b"", b"glTF", b"{}", b"[1]", b"\xff" * 40):
        path.write_bytes(content)
        with pytest.raises(ValueError):
            read_gltf(path)
    with pytest.raises(ValueError, match="there is no file"):
        read_gltf(tmp_path / "none.glb")
