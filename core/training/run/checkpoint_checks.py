"""Compare what a checkpoint declares with bounds, before anything is computed from it.

A file may be forged, or written by a faulty program.  Its tensors must not take more memory than
the file has bytes, and its options and mesh must be ones that a run can have.
"""

import pickletools
import zipfile
from pathlib import Path

import numpy as np
import torch

from ...base.schema import check, flag, integer, listing, number, text, vector
from ...base.streams import shown
from ...field import check_geometry
from ...geometry import TetMesh, tet_neighbours
from ..train_options import DEEPEST, WIDEST, TrainOptions

LARGEST_SCALE = 2.0**30  # of a loss
MOST_VALUES = 2**20  # that are no arrays; one that stands in many places counts in each
LONGEST_PICKLE = 2**18  # bytes
MOST_TUPLES = 2**12
PICKLE = "data.pkl"  # torch's name for what is no array
TUPLES = "TUPLE", "TUPLE1", "TUPLE2", "TUPLE3"
REPEATED = "BINUNICODE", "GLOBAL", "EMPTY_LIST", "EMPTY_DICT"  # what may stand in many places
CODES = {  # all that is in it
    *("PROTO", "STOP", "MARK", "NONE", "NEWFALSE", "NEWTRUE", "BININT", "BININT1", "BININT2"),
    *("LONG1", "BINFLOAT", "EMPTY_TUPLE", "APPEND", "APPENDS"),
    *("SETITEM", "SETITEMS", "BINPUT", "LONG_BINPUT", "BINGET", "LONG_BINGET", "BINPERSID"),
    *("REDUCE", *TUPLES, *REPEATED),
}
MADE = "collections OrderedDict", "torch._utils _rebuild_tensor_v2"  # and kinds of storages
OPTIONS = {  # but for the box, the other numbers and what TrainOptions checks
    "spacing": number(0.002, 0.5),
    "coarse_steps": integer(0, 10**8),
    "fine_steps": integer(0, 10**8),
    "level_count": integer(1, 10),
    "table_size_log2": integer(1, 24),
    "march_step": number(1e-4, 1.0),
    "samples_per_step": integer(1, 2**26),
    "learning_rate": number(0.0, 1e3),
    "surroundings": text(),
    "view_dependence": flag,
    "color_width": integer(1, WIDEST),
    "color_depth": integer(0, DEEPEST),
    "distortion": number(0.0, 1e6),
    "table_decay": number(0.0, 1e6),
    "strong_decay": number(0.0, 1e6),
    "depth_cost": number(0.0, 1e6),
    "seed": integer(0, 2**63 - 1),
}


def check_archive(path: Path) -> None:
    """Whether a file's entries are whole, not larger than the file, and quickly read by torch.

    torch looks at no checksum, and unpacks what is compressed, however long.

    Raises:
        zipfile.BadZipFile, or what zipfile and pickletools raise for damaged files.
    """
    size = path.stat().st_size
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        if (
            any(entry.compress_type != zipfile.ZIP_STORED for entry in entries)
            or sum(entry.file_size for entry in entries) > size
        ):
            raise zipfile.BadZipFile("it is compressed, or declares more than it holds")
        damaged = archive.testzip()
        if damaged is not None:
            raise zipfile.BadZipFile(f"{shown(damaged)} is damaged")
        names = [entry.filename.lower() for entry in entries]  # torch takes either case
        pickles = [e for e in entries if e.filename.lower().endswith(PICKLE)]
        first = min((entry.header_offset for entry in entries), default=1)
        if len(set(names)) < len(names) or len(pickles) != 1 or first > 0:
            raise zipfile.BadZipFile("it is not what torch wrote")  # or torch would read another
        if pickles[0].file_size > LONGEST_PICKLE:
            raise zipfile.BadZipFile("its lists and texts are longer than any checkpoint's")
        check_pickle(archive.read(pickles[0]))


def check_pickle(content: bytes) -> None:
    """Whether a pickle has only what ours have, before any of it is made.

    Tuples are never referred to again: one that holds another twice, which does the same, and so
    on takes years as a key of a dictionary.  One in one in one overflows the stack there.

    Raises:
        ValueError: It has something else.
    """
    tuples, last, repeated = 0, "", set()
    for code, argument, _ in pickletools.genops(content):
        name = code.name
        if name not in CODES or (name == "GLOBAL" and not is_made(argument)):
            raise ValueError(f"it holds {shown(argument if name == 'GLOBAL' else name)}")
        if name.endswith("PUT") and last in REPEATED:
            repeated.add(argument)
        elif name.endswith("PUT"):
            repeated.discard(argument)
        tuples += name in TUPLES
        if tuples > MOST_TUPLES or (name.endswith("GET") and argument not in repeated):
            raise ValueError("its lists and texts are longer than it holds")
        last = name


def is_made(name: str) -> bool:
    """Whether it is a function or type, as "module name", that makes something of a checkpoint."""
    return name in MADE or (name.startswith("torch ") and name.endswith("Storage"))


def check_content(content, most: int) -> None:
    """Whether what was read is as small as its file, also when it is copied or printed.

    A tensor with steps of 0 bytes shows one number as often as it likes; a list can hold another
    one twice, which does the same, and so on.

    Args:
        most: Bytes of all tensors, and characters of all texts.

    Raises:
        ValueError: It is not.
    """
    seen, ahead, size, length, count = set(), [content], 0, 0, 0
    while ahead:
        value = ahead.pop()
        count += 1
        if isinstance(value, torch.Tensor):
            if id(value) not in seen:
                size += value.numel() * value.element_size()
            seen.add(id(value))
            if value.layout != torch.strided or value.device.type != "cpu" or size > most:
                raise ValueError("its arrays declare more than it holds")
        elif isinstance(value, dict):
            ahead += value.values()
            ahead += value.keys()
        elif isinstance(value, list | tuple | set | frozenset):
            ahead += value
        elif isinstance(value, str | bytes):
            length += len(value)
        if count + len(ahead) > MOST_VALUES or length > most:
            raise ValueError("its lists and texts are longer than it holds")


def checked_options(values: dict) -> TrainOptions:
    """The options; a FileError or TypeError if no run has such."""
    options = TrainOptions(**values)
    for name, good in OPTIONS.items():
        value = getattr(options, name)
        check(good(value), f"its option {name} is {shown(value)}")
    numbers = [*(options.aabb or ()), options.scene_radius or 1.0]
    check(options.aabb is None or len(options.aabb) == 6, "its box has no six numbers")
    check(listing(number())(numbers), "its box is not finite")
    return options


def checked_mesh(tensors, options: TrainOptions) -> TetMesh:
    """The mesh; a ValueError if its indices lead out of it, or if no ray can meet it."""
    mesh = TetMesh(*(tensor.numpy() for tensor in tensors))
    kinds = mesh.rest_vertices.dtype, mesh.addresses.dtype, mesh.tets.dtype
    if kinds != (np.float64, np.int32, np.int32) or mesh.tet_count == 0:
        raise ValueError("its mesh is of another kind")
    limit = 2**20 >> (options.level_count - 1)
    if (
        not np.isfinite(mesh.rest_vertices).all()
        or not (0 <= mesh.tets.min() and mesh.tets.max() < mesh.vertex_count)
        or not (0 <= mesh.addresses.min() and mesh.addresses.max() < limit)
    ):
        raise ValueError("its mesh is damaged")
    check_geometry(mesh, tet_neighbours(mesh.tets), options.march_step)
    return mesh


def checked_scale(scale) -> float:
    """The scale of the loss that a checkpoint's moments are of.

    Raises:
        FileError: No run has such a one.
    """
    check(number(1.0, LARGEST_SCALE, float)(scale), f"a loss scaled by {shown(scale)}")
    return scale


def checked_matrix(values) -> np.ndarray:
    """From the world to the model; a FileError if it is none.  [4, 4]"""
    good = vector(4, vector(4, number()))(values)
    check(good, "its transform is no 4 times 4 numbers")
    return np.array(values, float)


def checked_report(report) -> dict:
    """The figures of a run; a FileError, TypeError or KeyError if it can't go on from them."""
    good = isinstance(report, dict) and isinstance(report.get("history", []), list)
    check(good, "its report is none")
    whole = [report["view_count"], *report["image_size"]]
    check(vector(3, integer())(whole), "its report counts no images")
    box = report.get("object_box", [[0.0] * 3] * 2)
    good = vector(2, vector(3, number()))(box)
    good = good and number()(report["seconds"]) and number()(report.get("object_slack", 0.0))
    check(good, "the box in its report is none")
    gains = [report.get(key, 0.0) for key in ("depth_gain", "decay_gain")]
    check(listing(number())(gains), "what its trials gained is no number")
    if "object_box" in report and not {"object_stands", "object_slack"} <= set(report):
        raise KeyError("object_stands")
    return report
