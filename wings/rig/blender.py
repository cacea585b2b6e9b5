"""What the Blender add-on exports: weights, bones, clips and shape keys as one .npz.

docs/rigs.md describes the file field by field.  Blender's own posed vertices, where the file has
them, decide what a clip becomes: bones where our skinning gives the same vertices, else all
vertices over time (shape keys, other modifiers).

Shapes: V vertices, B bones, K frames of a clip, S shape keys.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.base.archive import one_sentence, open_archive
from ...core.base.schema import check, declared, listing, text
from ...core.geometry import TetMesh, boundary_faces, tet_neighbours
from .clips import Clip, VertexClip, clip_of_matrices
from .rig import MOST_CLIPS, Rig
from .skeleton import MOST_BONES, Skeleton
from .skinning import skinned
from .weights import harmonic_weights

FORMAT, FORMAT_VERSION = "deformrf-blender", 1
LONGEST_META = 2**20  # bytes
MOST_FRAMES, MOST_SHAPES = 2**16, 2**10
MOVED = 1e-4  # of the mesh's size: rest vertices farther from the model's belong to another one
SAME = 1e-4  # of the mesh's size: vertices of bones that are Blender's


@dataclass(frozen=True)
class BlenderClip:
    """One animation as Blender played it."""

    name: str
    times: np.ndarray  # [K] float64 [s]
    matrices: np.ndarray  # [K, B, 4, 4] float64, skinning
    shape_values: np.ndarray  # [K, S] float32
    vertices: np.ndarray | None  # [K, V, 3] float32, as Blender posed them


@dataclass(frozen=True)
class BlenderRig:
    """The file's contents, checked against a mesh."""

    blender: str  # its version
    skeleton: Skeleton
    rest_vertices: np.ndarray  # [V, 3] float32
    weights: np.ndarray  # [V, B] float32; rows sum to 1, or are 0 where nobody painted
    method: str  # of rig.METHODS, as Blender posed
    shapes: np.ndarray  # [S, V, 3] float32, offsets from rest
    clips: tuple[BlenderClip, ...]


def read_blender(path: str | Path, mesh: TetMesh) -> BlenderRig:
    """The file of the add-on, for a model with that mesh.

    Raises:
        ValueError: The file is missing, damaged, or of another model.
    """
    path = Path(path)
    with one_sentence(path), open_archive(path, "rig of the Blender add-on") as arrays:
        return _read(arrays, mesh)


def rig_of(found: BlenderRig, mesh: TetMesh, harmonic: bool = True) -> Rig:
    """A rig of what Blender made.

    Args:
        harmonic: Weights inside follow from those of the surface; else they stay as they are
            in the file.

    Raises:
        ValueError: Vertices have no weight, or a clip shears bones and has no vertices.
    """
    if harmonic:
        faces, _ = boundary_faces(mesh.tets, tet_neighbours(mesh.tets))
        outside = np.unique(faces)
        _check_painted(found.weights[outside], "of the surface ", outside)
        weights = harmonic_weights(mesh, outside, found.weights[outside])
    else:
        _check_painted(found.weights, "", np.arange(mesh.vertex_count))
        weights = found.weights
    return Rig(found.skeleton, weights, tuple(_clip(found, clip, mesh) for clip in found.clips))


def skinning_error(found: BlenderRig, clip: BlenderClip, mesh: TetMesh) -> float:
    """How far our skinning with the file's weights is from Blender's vertices at most."""
    rest, error = mesh.rest_vertices, 0.0
    still = found.weights.sum(axis=1) == 0.0  # what no bone moves stays where it is, as in Blender
    for matrices, theirs in zip(clip.matrices, clip.vertices, strict=True):
        ours = skinned(rest, found.weights, matrices, found.method)
        ours[still] = rest[still]
        error = max(error, float(np.abs(ours - theirs).max()))
    return error


def _clip(found, clip, mesh) -> Clip | VertexClip:
    size = float(np.ptp(mesh.rest_vertices, axis=0).max())
    if clip.vertices is not None and skinning_error(found, clip, mesh) > SAME * size:
        return VertexClip(clip.name, clip.times, clip.vertices)
    if clip.vertices is None and (clip.shape_values != 0.0).any():
        rest = mesh.rest_vertices + np.einsum("ks,svx->kvx", clip.shape_values, found.shapes)
        frames = [
            skinned(rest[k], found.weights, matrices, found.method)
            for k, matrices in enumerate(clip.matrices)
        ]
        return VertexClip(clip.name, clip.times, np.array(frames, np.float32))
    try:
        return clip_of_matrices(clip.name, found.skeleton, clip.times, clip.matrices)
    except ValueError:
        if clip.vertices is None:
            raise
        return VertexClip(clip.name, clip.times, clip.vertices)


def _check_painted(weights, which, ids):
    bare = weights.sum(axis=1) == 0.0
    if bare.any():
        raise ValueError(
            f"{int(bare.sum())} vertices {which}have no weight, the first is vertex "
            f"{ids[int(np.argmax(bare))]}: paint them in Blender, or bind again"
        )


def _read(arrays, mesh) -> BlenderRig:
    meta = _meta(arrays)
    bones, count = len(meta["bones"]), mesh.vertex_count
    weights = _shape(arrays, "weights")
    if weights[:1] != (count,):
        raise ValueError(
            f"it has weights for {weights[0] if weights else 0} vertices, but the model has "
            f"{count}: it belongs to another model"
        )
    rest = _array(arrays, "rest_vertices", "f4", (count, 3))
    moved = np.abs(rest - mesh.rest_vertices).max(axis=1)
    if not (moved <= MOVED * np.ptp(mesh.rest_vertices)).all():
        raise ValueError(
            f"its vertex {int(np.argmax(moved))} lies elsewhere at rest than the model's: it "
            "belongs to another model, or its vertices are in another order"
        )
    skeleton = Skeleton(
        tuple(meta["bones"]),
        _array(arrays, "bone_parents", "i4", (bones,)),
        _array(arrays, "bone_rest", "f8", (bones, 4, 4)),
        _array(arrays, "bone_tails", "f8", (bones, 3)),
    )
    shape_count = len(meta["shape_keys"])
    return BlenderRig(
        blender=str(meta.get("blender"))[:20],
        skeleton=skeleton,
        rest_vertices=rest,
        weights=_weights(_array(arrays, "weights", "f4", (count, bones))),
        method="dual quaternion" if meta.get("preserve_volume") is True else "linear",
        shapes=_array(arrays, "shape_keys", "f4", (shape_count, count, 3)),
        clips=tuple(
            _read_clip(arrays, i, name, bones, count, shape_count)
            for i, name in enumerate(meta["clips"])
        ),
    )


def _read_clip(arrays, i, name, bones, vertex_count, shape_count) -> BlenderClip:
    (frames,) = _shape(arrays, f"times_{i}") or (0,)
    if not 0 < frames <= MOST_FRAMES:
        raise ValueError(
            f"clip {name[:50]!r} has {frames} frames; it has to have 1 to {MOST_FRAMES}"
        )
    vertices = None
    if f"vertices_{i}" in arrays:
        vertices = _array(arrays, f"vertices_{i}", "f4", (frames, vertex_count, 3))
    return BlenderClip(
        name,
        _array(arrays, f"times_{i}", "f8", (frames,)),
        _array(arrays, f"matrices_{i}", "f8", (frames, bones, 4, 4)),
        _array(arrays, f"shape_values_{i}", "f4", (frames, shape_count)),
        vertices,
    )


def _weights(weights):
    """Rows that sum to 1, or to 0 where nobody painted."""
    sums = weights.sum(axis=1)
    wrong = (weights < 0.0).any(axis=1) | ((sums != 0.0) & (np.abs(sums - 1.0) > 1e-3))
    if wrong.any():
        vertex = int(np.argmax(wrong))
        raise ValueError(
            f"the weights of vertex {vertex} sum to {sums[vertex]:.4g} or are negative "
            f"({int(wrong.sum())} vertices): export them again with the add-on, which normalizes"
        )
    return weights / np.where(sums > 0.0, sums, 1.0)[:, None]


def _meta(arrays) -> dict:
    size = _shape(arrays, "meta")
    check(len(size) == 1 and size[0] <= LONGEST_META, f"its 'meta' is {list(size)} long")
    try:
        meta = json.loads(_array(arrays, "meta", "u1", size).tobytes().decode())
    except (ValueError, RecursionError) as error:
        raise ValueError("its 'meta' is no JSON") from error
    if not isinstance(meta, dict) or meta.get("format") != FORMAT:
        raise ValueError(f"its 'meta' names no format '{FORMAT}'")
    if meta.get("format_version") != FORMAT_VERSION:
        version = str(meta.get("format_version"))[:20]
        raise ValueError(f"it has format version {version!r}, this program reads {FORMAT_VERSION}")
    for name, most in (("bones", MOST_BONES), ("clips", MOST_CLIPS), ("shape_keys", MOST_SHAPES)):
        good = listing(text(), most)(meta.get(name))
        check(good, f"its '{name}' is no list of at most {most} names")
    return meta


def _shape(arrays, name):
    check(name in arrays, f"it has no array '{name}'")
    return arrays[name].shape


def _array(arrays, name, dtype, shape):
    """Finite values of an array of that type and shape."""
    _shape(arrays, name)
    values = np.asarray(declared(arrays, name, dtype, shape))
    check(values.dtype.kind != "f" or np.isfinite(values).all(), f"'{name}' holds NaN or infinity")
    return values
