"""A skinned mesh of a glTF 2.0 file as a rig: its bones, weights on its surface, and clips.

glTF moves a point x of a skinned mesh by Σ w_j G_j(t) B_j⁻¹ x: G_j is the global matrix of the
node that is joint j, B_j⁻¹ its inverse bind matrix.  Bones here have rigid rest frames
R_j = C K B_j / s_j, where

    C    turns y up into z up
    K    takes the space of the mesh to that of the scene: G_0(rest) B_0⁻¹ of the first joint
    s_j  is the scale of C K B_j

With F_j = C G_j / s_j the skinning matrices F_j R_j⁻¹ are those of the file.  So a bone's local
matrix is s_p A L_j / s_j: L_j the node's own, A the constant nodes between it and its parent
bone (C among them for a root), s_p the parent's scale.  A is a similarity, so it maps the keys of
translations, rotations and scales one by one, for each interpolation.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from . import rotations
from .clips import PATHS, Channel, Clip
from .gltf_file import Gltf, check
from .gltf_skin import bind_matrices, chosen_skin, surface
from .skeleton import LONGEST_NAME, MOST_BONES, Skeleton, parents_first

Y_UP_TO_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
EVEN = 1e-3  # how much scales of a matrix may differ, relative


@dataclass(frozen=True)
class GltfRig:
    """A skinned mesh; z is up, lengths as in the file (glTF: meters)."""

    skeleton: Skeleton
    clips: tuple[Clip, ...]
    points: np.ndarray  # [S, 3] at rest
    triangles: np.ndarray  # [N, 3] int32, ids of points
    point_weights: np.ndarray  # [S, B] float32


def read_gltf(path) -> GltfRig:
    """Read the skinned mesh of a .glb or .gltf; of several skins that with the most points.

    Raises:
        ValueError: The file is none, has no skin, or is damaged.
    """
    path = Path(path)
    try:
        return _read(Gltf(path))
    except MemoryError as error:
        raise ValueError(f"{path} needs more memory than is free") from error
    except ModuleNotFoundError:
        raise
    except ValueError as error:
        line = " ".join(str(error).split())[:300]
        raise ValueError(line if str(path) in line else f"{path}: {line}") from error
    except Exception as error:  # a file can hold anything: what was not foreseen is damage too
        raise ValueError(f"{path} is no glTF file, or is damaged ({error!r:.100})") from error


def aligned(rig: GltfRig, matrix) -> GltfRig:
    """The rig in another space.

    Args:
        matrix: A similarity to that space.  [4, 4]
    """
    matrix = np.asarray(matrix, float)
    scale = scale_of(matrix, "the matrix that places the rig")
    skeleton = rig.skeleton
    rest = matrix @ skeleton.rest
    rest[:, :3, :3] /= scale
    moved = replace(skeleton, rest=rest, tails=skeleton.tails @ matrix[:3, :3].T + matrix[:3, 3])
    # A root's keys are in the old space; others grow with their parents.
    maps = [_Map(matrix if p < 0 else _scaling(scale), 1.0, scale) for p in skeleton.parents]
    clips = tuple(
        replace(clip, channels=tuple(maps[c.bone].channel(c, c.bone) for c in clip.channels))
        for clip in rig.clips
    )
    points = rig.points @ matrix[:3, :3].T + matrix[:3, 3]
    return replace(rig, skeleton=moved, clips=clips, points=points)


def scale_of(matrix, whose: str) -> float:
    """The scale of a similarity; ValueError if a matrix is none."""
    matrix = np.asarray(matrix, float)
    check(
        matrix.shape == (4, 4) and np.isfinite(matrix).all() and (matrix[3] == [0, 0, 0, 1]).all(),
        f"{whose} is no finite 4×4 matrix with the last row 0 0 0 1",
    )
    volume = np.linalg.det(matrix[:3, :3])
    check(volume > 0.0, f"{whose} mirrors, or flattens (its determinant is {volume:.3g})")
    scale = float(np.cbrt(volume))
    error = np.abs(matrix[:3, :3].T @ matrix[:3, :3] / scale**2 - np.eye(3)).max()
    check(
        error < EVEN,
        f"{whose} scales unevenly or shears; apply the scale of object and bones first",
    )
    return scale


class _Map:
    """A bone's local values in the file -> here: matrix · values, lengths after it / divisor."""

    def __init__(self, matrix, factor: float, divisor: float):
        """The local matrix becomes factor · matrix · local / divisor."""
        scale = scale_of(matrix, "the transform of a node above a bone")
        self.linear, self.shift = factor * matrix[:3, :3], factor * matrix[:3, 3]
        self.turn = rotations.quaternion_of(matrix[:3, :3] / scale)
        self.scale = factor * scale / divisor

    def values(self, path: str, values, tangents=False):
        if path == "rotation":
            return rotations.product(self.turn, values)
        if path == "scale":
            return self.scale * values
        moved = values @ self.linear.T
        return moved if tangents else moved + self.shift

    def channel(self, channel: Channel, bone: int) -> Channel:
        keys = channel.values
        if channel.interpolation == "CUBICSPLINE":
            parts = [self.values(channel.path, keys[:, i], tangents=i != 1) for i in range(3)]
            keys = np.stack(parts, axis=1)
        else:
            keys = self.values(channel.path, keys)
        return replace(channel, bone=bone, values=keys)


@dataclass
class _Nodes:
    """The nodes of a file: N of them, each under one parent."""

    parents: list[int]
    names: list[str]
    values: dict[str, np.ndarray]  # by path: translations [N, 3], rotations [N, 4], scales [N, 3]

    def local(self, node: int):
        matrix = np.eye(4)
        turn = rotations.matrix_of(self.values["rotation"][node])
        matrix[:3, :3] = turn * self.values["scale"][node]
        matrix[:3, 3] = self.values["translation"][node]
        return matrix

    def above(self, node: int, end: int):
        """The product of the nodes above a node, up to the ancestor `end`, without both."""
        matrix, node = np.eye(4), self.parents[node]
        while node not in (-1, end):
            matrix, node = self.local(node) @ matrix, self.parents[node]
        return matrix

    def ancestors(self, node: int):
        while (node := self.parents[node]) >= 0:
            yield node


def _read(gltf: Gltf) -> GltfRig:
    nodes = _nodes(gltf)
    skin, meshes = chosen_skin(gltf)
    points, triangles, joints, weights = surface(gltf, meshes)
    check(
        0 < len(skin.joints) <= MOST_BONES,
        f"its skin has {len(skin.joints)} joints, not 1 to {MOST_BONES}",
    )
    for joint in skin.joints:
        gltf.at(gltf.parts.nodes, joint, "node", "joints")
    check(len(set(skin.joints)) == len(skin.joints), "its skin names a joint twice")
    check(
        joints.max(initial=0) < len(skin.joints),
        f"points are bound to joint {joints.max(initial=0)}, but the skin has {len(skin.joints)}",
    )
    animated = {c.target.node for a in gltf.parts.animations for c in a.channels}
    above = {n for joint in skin.joints for n in nodes.ancestors(joint)}
    bones = list(skin.joints) + sorted((animated & above) - set(skin.joints))
    check(len(bones) <= MOST_BONES, f"its skeleton has {len(bones)} bones, over {MOST_BONES}")
    parents = [next((bones.index(n) for n in nodes.ancestors(b) if n in bones), -1) for b in bones]
    order = parents_first([nodes.names[b] for b in bones], parents)
    binds = bind_matrices(gltf, skin)
    globals_ = [nodes.above(b, -1) @ nodes.local(b) for b in bones]
    to_scene = globals_[0] @ np.linalg.inv(binds[0])
    scale_of(to_scene, "the way from the mesh to its bones")
    to_scene = Y_UP_TO_Z_UP @ to_scene
    rest = [to_scene @ bind for bind in binds]
    rest += [Y_UP_TO_Z_UP @ matrix for matrix in globals_[len(binds) :]]
    scales = [
        scale_of(m, f"the rest frame of bone {nodes.names[b]!r}")
        for m, b in zip(rest, bones, strict=True)
    ]
    frames = np.array(rest)
    frames[:, :3, :3] /= np.array(scales)[:, None, None]
    frames[:, :3, :3] = _orthogonal(frames[:, :3, :3])
    points = points @ to_scene[:3, :3].T + to_scene[:3, 3]
    dense = np.zeros((len(points), len(bones)))
    np.add.at(dense, (np.arange(len(points))[:, None], joints), weights)
    dense = (dense / dense.sum(axis=1, keepdims=True)).astype(np.float32)[:, order]
    place = {old: new for new, old in enumerate(order)}
    new_parents = np.array([place.get(parents[old], -1) for old in order], np.int32)
    frames = frames[order]
    skeleton = Skeleton(
        _unique([nodes.names[bones[old]] for old in order]),
        new_parents,
        frames,
        tails_from(frames[:, :3, 3], new_parents, points, dense),
    )
    maps = []
    for old in order:
        parent = parents[old]
        between = nodes.above(bones[old], bones[parent] if parent >= 0 else -1)
        if parent < 0:
            between = Y_UP_TO_Z_UP @ between
        maps.append(_Map(between, scales[parent] if parent >= 0 else 1.0, scales[old]))
    bone_nodes = [bones[old] for old in order]
    return GltfRig(
        skeleton, _clips(gltf, nodes, bone_nodes, maps, skeleton), points, triangles, dense
    )


def tails_from(heads, parents, points, weights) -> np.ndarray:
    """Tails of joints that have none, as glTF's: where a bone's matter is.  [B, 3]

    A bone with one child ends there, one with several at their middle.  A leaf ends twice as far
    from its head as the middle of the points that it moves, or else goes on like its parent.
    """
    count = len(heads)
    tails = np.array(heads, float)
    total = weights.sum(axis=0, dtype=float)
    middles = weights.astype(float).T @ points / np.maximum(total, 1e-12)[:, None]
    size = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 1.0
    for bone in range(count):
        ends = heads[parents == bone]
        far = ends[np.linalg.norm(ends - heads[bone], axis=1) > 1e-6 * size]
        if len(far):
            tails[bone] = far.mean(axis=0)
        elif total[bone] > 1e-6:
            tails[bone] = 2.0 * middles[bone] - heads[bone]
        elif parents[bone] >= 0:
            tails[bone] += 0.5 * (heads[bone] - heads[parents[bone]])
        if np.linalg.norm(tails[bone] - heads[bone]) < 1e-3 * size:
            tails[bone] = heads[bone] + (0.0, 0.0, 0.02 * size)
    return tails


def _nodes(gltf: Gltf) -> _Nodes:
    parts = gltf.parts.nodes
    check(0 < len(parts) <= 2**16, f"it has {len(parts)} nodes, not 1 to {2**16}")
    parents = [-1] * len(parts)
    for number, node in enumerate(parts):
        for child in node.children or ():
            gltf.at(parts, child, "node", f"children of node {number}")
            check(parents[child] < 0, f"node {child} has two parents")
            parents[child] = number
    names = [_printable(node.name, f"bone {i}") for i, node in enumerate(parts)]
    parents_first(names, parents)  # a cycle ends here
    values = {path: np.zeros((len(parts), 4 if path == "rotation" else 3)) for path in PATHS}
    for number, node in enumerate(parts):
        if node.matrix is not None:
            matrix = np.array(node.matrix, float).reshape(4, 4).T
            scale = scale_of(matrix, f"the matrix of node {number}")
            turn = rotations.quaternion_of(matrix[:3, :3] / scale)
            trs = matrix[:3, 3], turn, np.full(3, scale)
        else:
            trs = (
                node.translation or (0, 0, 0),
                node.rotation or (0, 0, 0, 1),
                node.scale or (1,) * 3,
            )
        for path, value in zip(PATHS, trs, strict=True):
            values[path][number] = np.array(value, float)
    good = all((np.abs(v) <= 1e6).all() for v in values.values())  # NaN fails, too
    check(good, "the transform of a node holds NaN, or numbers beyond 1e6")
    values["rotation"] = rotations.unit(values["rotation"])
    return _Nodes(parents, names, values)


def _clips(gltf: Gltf, nodes: _Nodes, bone_nodes, maps, skeleton: Skeleton) -> tuple[Clip, ...]:
    bone_of = {node: bone for bone, node in enumerate(bone_nodes)}
    rest = skeleton.rest_pose
    clips = []
    for number, animation in enumerate(gltf.parts.animations):
        name = _printable(animation.name, f"clip {number}")
        channels = []
        for entry in animation.channels:
            path = entry.target.path
            if path not in PATHS or entry.target.node not in bone_of:
                continue  # shape keys, cameras, other objects
            what = f"keys of clip {name!r}"
            sampler = gltf.at(animation.samplers, entry.sampler, "sampler", what)
            times = gltf.numbers(sampler.input, "SCALAR", f"times of clip {name!r}")
            kind = "VEC4" if path == "rotation" else "VEC3"
            keys = gltf.numbers(sampler.output, kind, what)
            interpolation = sampler.interpolation or "LINEAR"
            if interpolation == "CUBICSPLINE":
                check(len(keys) % 3 == 0, f"the {what} lack tangents")
                keys = keys.reshape(-1, 3, keys.shape[1])
            bone = bone_of[entry.target.node]
            channel = Channel(bone, path, interpolation, times.astype(float), keys.astype(float))
            channels.append(maps[bone].channel(channel, bone))
        # A node that isn't animated keeps its own transform, which may differ from the bind pose.
        moving = {(c.bone, c.path) for c in channels}
        for bone, node in enumerate(bone_nodes):
            for path in PATHS:
                value = maps[bone].values(path, nodes.values[path][node])
                still = getattr(rest, f"{path}s")[bone]
                if path == "rotation" and value @ still < 0.0:
                    value = -value
                if (bone, path) not in moving and np.abs(value - still).max() > 1e-5:
                    key = np.array(value, float)[None]
                    channels.append(Channel(bone, path, "STEP", np.zeros(1), key))
        last = max((float(c.times[-1]) for c in channels), default=0.0)
        clips.append(Clip(name, last, tuple(channels)))
    names = _unique([clip.name for clip in clips])
    return tuple(replace(clip, name=name) for clip, name in zip(clips, names, strict=True))


def _printable(name, otherwise: str) -> str:
    words = "".join(c if c.isprintable() else "?" for c in str(name or ""))[: LONGEST_NAME - 5]
    return words or otherwise


def _unique(names) -> tuple[str, ...]:
    """Names, those that come again with a number."""
    found = []
    for name in names:
        number, plain = 1, name
        while name in found:
            name, number = f"{plain}.{number:03}", number + 1
        found.append(name)
    return tuple(found)


def _orthogonal(turns):
    """The nearest rotations: of matrices that files hold in float32."""
    u, _, vt = np.linalg.svd(turns)
    return u @ vt


def _scaling(scale: float):
    return np.diag([scale, scale, scale, 1.0])
