"""Bones and skinning matrices in a JSON file, as scripts write them from other programs.

    {"bones": [{"name", "parent": name or null, "head": [3], "tail": [3]}, ...],
     "clips": {name: {"duration": s, "samples": [{"time": s,
         "skinning_matrices": {bone: [[4] * 4]}}, ...]}, ...}}

Lengths are in one space, that of the photographs' cameras; z is up.
"""

import json
from pathlib import Path

import numpy as np

from ...core.base.reading import read_bytes
from ...core.base.streams import one_line, shown
from .clips import Clip, clip_of_matrices
from .gltf import GltfRig
from .gltf_file import json_values
from .rig import MOST_CLIPS
from .skeleton import FARTHEST, MOST_BONES, make_skeleton, parents_first

LARGEST_FILE = 2**27  # bytes
MOST_VALUES = 2**22  # of the JSON


def read_matrices(path: str | Path) -> GltfRig:
    """Read such a file; the surface of the rig is empty.

    Raises:
        ValueError: The file is none, or is damaged.
    """
    path = Path(path)
    try:
        text = read_bytes(path, LARGEST_FILE)
        if json_values(text) > MOST_VALUES:
            raise ValueError(f"it has more than {MOST_VALUES} values; export fewer clips or frames")
        return _read(json.loads(text))
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from error
    except (KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError(f"{path} is no file of bones and matrices ({error!r:.100})") from error
    except ValueError as error:
        raise ValueError(f"{path}: {one_line(error)}") from error


def _read(values) -> GltfRig:
    bones = values["bones"]
    if not (isinstance(bones, list) and 1 <= len(bones) <= MOST_BONES):
        raise ValueError(f"it has no list of 1 to {MOST_BONES} bones")
    names = [bone["name"] for bone in bones]
    number = {name: i for i, name in enumerate(names)}
    for bone in bones:
        if bone["parent"] is not None and bone["parent"] not in number:
            name, parent = shown(bone["name"]), shown(bone["parent"])
            raise ValueError(f"the parent of bone {name}, {parent}, is missing")
    parents = [-1 if b["parent"] is None else number[b["parent"]] for b in bones]
    order = parents_first(names, parents)
    place = {old: new for new, old in enumerate(order)}
    skeleton = make_skeleton(
        [names[old] for old in order],
        [place.get(parents[old], -1) for old in order],
        [_vector(bones[old]["head"]) for old in order],
        [_vector(bones[old]["tail"]) for old in order],
    )
    clips = values.get("clips") or {}
    if not isinstance(clips, dict) or len(clips) > MOST_CLIPS:
        raise ValueError(f"its clips are no list of at most {MOST_CLIPS}")
    return GltfRig(
        skeleton,
        tuple(_clip(name, clip, skeleton) for name, clip in clips.items()),
        np.zeros((0, 3)),
        np.zeros((0, 3), np.int32),
        np.zeros((0, skeleton.bone_count), np.float32),
    )


def _vector(value):
    if not (isinstance(value, list) and len(value) == 3):
        raise ValueError(f"a head or tail is {str(value)[:60]}, not three numbers")
    found = np.array(value, float)
    if not (np.abs(found) <= FARTHEST).all():  # NaN fails, too
        raise ValueError(f"a head or tail is {value}, beyond {FARTHEST:g}")
    return found


def _clip(name, values, skeleton) -> Clip:
    matrices, times = [], []
    for sample in values["samples"]:
        given = sample["skinning_matrices"]
        missing = [bone for bone in skeleton.names if bone not in given]
        if missing:
            raise ValueError(f"clip {shown(name)} has no matrix of bone {shown(missing[0])}")
        matrices.append([given[bone] for bone in skeleton.names])
        times.append(sample["time"])
    if not times:
        raise ValueError(f"clip {shown(name)} has no samples")
    clip = clip_of_matrices(name, skeleton, np.array(times, float), np.array(matrices, float))
    return Clip(name, max(float(values["duration"]), clip.duration), clip.channels)
