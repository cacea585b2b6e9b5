"""A rig <-> plain arrays: in a file of its own (rig.npz), or inside a model file.

docs/model-format.md describes the arrays; their names begin with `rig_`.  Nothing in them is
trusted: sizes are compared before arrays are used, and `Rig`, `Skeleton` and the clips check what
they are made of.  Every error is a ValueError of one sentence.

Shapes: V vertices, B bones, W weights of a vertex, C channels of all clips, K keys of a clip.
"""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...core.base.archive import one_sentence, open_archive
from ...core.base.schema import check, declared, listing
from ...core.base.streams import shown
from .clips import INTERPOLATIONS, PATHS, Channel, Clip, VertexClip
from .rig import MOST_CLIPS, Rig
from .skeleton import MOST_BONES, Skeleton

FORMAT, FORMAT_VERSION = "deformrf-rig", 1
LONGEST_META = 2**20  # bytes
MOST_KEYS = 2**22  # of all channels
CHANNEL_COLUMNS = 5  # clip, bone, path, interpolation, keys


def arrays_of(rig: Rig) -> dict[str, np.ndarray]:
    """The arrays of a rig; `rig_from` reads them."""
    clips, channels, vertex_arrays = [], [], {}
    for number, clip in enumerate(rig.clips):
        kind = "bones" if isinstance(clip, Clip) else "vertices"
        clips.append({"name": clip.name, "kind": kind, "duration": clip.duration})
        if isinstance(clip, Clip):
            channels += [(number, channel) for channel in clip.channels]
        else:
            vertex_arrays[f"rig_frame_times_{number}"] = clip.times.astype(np.float64)
            vertex_arrays[f"rig_frames_{number}"] = clip.vertices.astype(np.float32)
    meta = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "bones": list(rig.skeleton.names),
        "clips": clips,
    }
    table = [
        [number, c.bone, PATHS.index(c.path), INTERPOLATIONS.index(c.interpolation), len(c.times)]
        for number, c in channels
    ]
    bones, weights = largest_weights(rig.weights)
    offset_arrays = {}
    if rig.offsets is not None:
        offsets = np.take_along_axis(rig.offsets, bones[..., None].astype(int), 1)
        offset_arrays["rig_offsets"] = offsets.astype(np.float32)
    return {
        "rig_meta": np.frombuffer(json.dumps(meta).encode(), np.uint8),
        "rig_parents": rig.skeleton.parents.astype(np.int32),
        "rig_rest": rig.skeleton.rest.astype(np.float64),
        "rig_tails": rig.skeleton.tails.astype(np.float64),
        "rig_weight_bones": bones,
        "rig_weights": weights,
        **offset_arrays,
        "rig_channels": np.array(table, np.int32).reshape(-1, CHANNEL_COLUMNS),
        "rig_times": _joined([c.times for _, c in channels]),
        "rig_values": _joined([c.values for _, c in channels]),
        **vertex_arrays,
    }


def rig_from(arrays: Mapping[str, np.ndarray], vertex_count: int) -> Rig:
    """The rig in a mapping of arrays, for a model of so many vertices.

    Raises:
        ValueError: The arrays are no rig of that model.
    """
    meta = _meta(arrays)
    names = meta["bones"]
    count = len(names)
    skeleton = Skeleton(
        tuple(names),
        _array(arrays, "rig_parents", "i4", (count,)),
        _array(arrays, "rig_rest", "f8", (count, 4, 4)),
        _array(arrays, "rig_tails", "f8", (count, 3)),
    )
    found = _shape(arrays, "rig_weights")
    check(
        len(found) == 2 and found[0] == vertex_count,
        f"its rig has weights for {found[0] if found else 0} vertices, but the model has "
        f"{vertex_count}; bind the rig to this model with deformrf rig bind",
    )
    width = found[1]
    check(width <= count, f"its rig has {width} weights a vertex, but {count} bones")
    bones = _array(arrays, "rig_weight_bones", "u2", (vertex_count, width))
    check(bones.max(initial=0) < count, f"its rig has weights of bone {bones.max(initial=0)}")
    values = _array(arrays, "rig_weights", "f4", (vertex_count, width))
    weights = np.zeros((vertex_count, count), np.float32)
    places = np.arange(vertex_count)[:, None], bones
    np.add.at(weights, places, values)
    offsets = None
    if "rig_offsets" in arrays:
        values = _array(arrays, "rig_offsets", "f4", (vertex_count, width, 3))
        offsets = np.zeros((vertex_count, count, 3), np.float32)
        np.add.at(offsets, places, values)
    return Rig(skeleton, weights, _clips(arrays, meta["clips"], vertex_count), offsets)


def load_rig(path: str | Path, vertex_count: int) -> Rig:
    """Read a rig.npz, or the rig of a model file, for a model of so many vertices.

    Raises:
        ValueError: The file is missing, has no rig, or none of that model.
    """
    path = Path(path)
    with one_sentence(path), open_archive(path, "rig file") as arrays:
        return rig_from(arrays, vertex_count)


def largest_weights(weights):
    """Each vertex's weights without zeros, padded to the longest row.

    Returns:
        Bones [V, W] uint16 and weights [V, W] float32.
    """
    used = weights > 0.0
    width = max(1, int(used.sum(axis=1).max(initial=0)))
    order = np.argsort(~used, axis=1, kind="stable")[:, :width]
    return order.astype(np.uint16), np.take_along_axis(weights, order, 1).astype(np.float32)


def _joined(arrays) -> np.ndarray:
    return np.concatenate([np.ravel(a) for a in arrays] or [[]]).astype(np.float64)


def _clips(arrays, entries, vertex_count) -> tuple[Clip | VertexClip, ...]:
    rows = _array(arrays, "rig_channels", "i4", (None, CHANNEL_COLUMNS))
    times = _array(arrays, "rig_times", "f8", (None,))
    values = _array(arrays, "rig_values", "f8", (None,))
    channels = [[] for _ in entries]
    first = first_value = 0
    for number, bone, path, interpolation, count in rows.tolist():
        check(
            0 <= number < len(entries)
            and entries[number]["kind"] == "bones"
            and 0 <= path < len(PATHS)
            and 0 <= interpolation < len(INTERPOLATIONS)
            and 0 < count <= len(times) - first,
            f"its rig has a channel {[number, bone, path, interpolation, count]}, which no clip of "
            "it can have",
        )
        inner = (4,) if PATHS[path] == "rotation" else (3,)
        inner = (3, *inner) if INTERPOLATIONS[interpolation] == "CUBICSPLINE" else inner
        size = count * int(np.prod(inner))
        check(first_value + size <= len(values), "its rig's 'rig_values' ends too early")
        keys = values[first_value : first_value + size].reshape(count, *inner)
        channel = Channel(
            bone, PATHS[path], INTERPOLATIONS[interpolation], times[first : first + count], keys
        )
        channels[number].append(channel)
        first, first_value = first + count, first_value + size
    check(
        first == len(times) and first_value == len(values),
        f"its rig has {len(times)} times and {len(values)} values, but its channels need {first} "
        f"and {first_value}",
    )
    clips = []
    for number, entry in enumerate(entries):
        if entry["kind"] == "bones":
            clips.append(Clip(entry["name"], float(entry["duration"]), tuple(channels[number])))
            continue
        frame_times = _array(arrays, f"rig_frame_times_{number}", "f8", (None,))
        shape = (len(frame_times), vertex_count, 3)
        frames = _array(arrays, f"rig_frames_{number}", "f4", shape)
        clips.append(VertexClip(entry["name"], frame_times, frames))
    return tuple(clips)


def _meta(arrays) -> dict:
    """The names in a rig's `rig_meta`, checked."""
    size = _shape(arrays, "rig_meta")
    check(len(size) == 1 and size[0] <= LONGEST_META, f"its 'rig_meta' is {list(size)} long")
    try:
        meta = json.loads(_array(arrays, "rig_meta", "u1", (None,)).tobytes().decode())
    except (ValueError, RecursionError) as error:
        check(False, f"its 'rig_meta' is no JSON ({type(error).__name__})")
    check(
        isinstance(meta, dict) and meta.get("format") == FORMAT,
        "its 'rig_meta' names no format 'deformrf-rig'",
    )
    version = meta.get("format_version")
    check(
        version == FORMAT_VERSION,
        f"its rig has format version {shown(version)}, this program reads {FORMAT_VERSION}",
    )
    bones, clips = meta.get("bones"), meta.get("clips")
    check(
        isinstance(bones, list) and len(bones) <= MOST_BONES,
        f"its rig's 'bones' is no list of at most {MOST_BONES} names",
    )
    check(
        listing(_is_clip, MOST_CLIPS)(clips),
        f"its rig's 'clips' is no list of at most {MOST_CLIPS} names, kinds and durations",
    )
    return meta


def _is_clip(entry) -> bool:
    return (
        isinstance(entry, dict)
        and entry.get("kind") in ("bones", "vertices")
        and type(entry.get("duration")) in (int, float)
    )


def _shape(arrays, name):
    check(name in arrays, f"its rig has no array '{name}'")
    return arrays[name].shape


def _array(arrays, name, dtype, shape):
    """The values of an array of that type and shape, as `declared` takes them."""
    _shape(arrays, name)
    found = declared(arrays, name, dtype, shape)
    longest = max(found.shape, default=0)
    check(longest <= MOST_KEYS, f"'{name}' has {longest} rows, more than {MOST_KEYS}")
    return np.asarray(found)
