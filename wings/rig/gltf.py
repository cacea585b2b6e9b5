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

from ...core.base.schema import check
from ...core.base.streams import one_line
from . import rotations
from .clips import PATHS, Channel, Clip
from .gltf_file import Gltf
from .gltf_nodes import placed, printable_name, read_nodes, scale_of, scales_of
from .gltf_skin import bind_matrices, chosen_skin, surface
from .rig import MOST_CLIPS
from .rigfile import MOST_KEYS
from .skeleton import MOST_BONES, Skeleton, parents_first

Y_UP_TO_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
MOST_CHANNELS = 2**15  # of all clips
MOST_WEIGHTS = 2**25  # points times bones


@dataclass(frozen=True)
class GltfRig:
    """A skinned mesh; z is up, lengths as in the file (glTF: meters)."""

    skeleton: Skeleton
    clips: tuple[Clip, ...]
    points: np.ndarray  # [S, 3] at rest
    triangles: np.ndarray  # [N, 3] int32, ids of points
    point_weights: np.ndarray  # [S, B] float32
    notes: tuple[str, ...] = ()  # sentences on what the file holds that is left out
    copyright: str = ""  # as the file says it


def read_gltf(path: str | Path) -> GltfRig:
    """Read the skinned mesh of a .glb or .gltf; of several skins that with the most points.

    Raises:
        ValueError: The file is none, has no skin, or is damaged.
    """
    path = Path(path)
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # NaN and infinite numbers are refused
            return _read(Gltf(path))
    except MemoryError as error:
        raise ValueError(f"{path} needs more memory than is free") from error
    except ValueError as error:
        line = one_line(error)
        raise ValueError(line if str(path) in line else f"{path}: {line}") from error
    except Exception as error:  # a file can hold anything: what was not foreseen is damage too
        raise ValueError(f"{path} is no glTF file, or is damaged ({error!r:.100})") from error


def aligned(rig: GltfRig, matrix: np.ndarray) -> GltfRig:
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
    grown = np.diag([scale, scale, scale, 1.0])
    maps = [_Map(matrix if p < 0 else grown, 1.0, scale) for p in skeleton.parents]

    def moved_channel(c: Channel):
        return replace(c, values=maps[c.bone].keys(c.path, c.interpolation, c.values))

    clips = tuple(
        replace(clip, channels=tuple(map(moved_channel, clip.channels))) for clip in rig.clips
    )
    points = rig.points @ matrix[:3, :3].T + matrix[:3, 3]
    return replace(rig, skeleton=moved, clips=clips, points=points)


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

    def keys(self, path: str, interpolation: str, keys):
        """The values of a channel."""
        if interpolation != "CUBICSPLINE":
            return self.values(path, keys)
        columns = [self.values(path, keys[:, i], tangents=i != 1) for i in range(3)]
        return np.stack(columns, axis=1)


def _read(gltf: Gltf) -> GltfRig:
    nodes = read_nodes(gltf)
    skin, meshes, notes = chosen_skin(gltf)
    bones = _bones(gltf, nodes, skin)
    there, binds = placed(gltf, nodes, bones), bind_matrices(gltf, skin)
    order = parents_first([nodes.names[b] for b in bones], there.parents)
    to_scene = there.frames[0] @ np.linalg.inv(binds[0])
    scale_of(to_scene, "the way from the mesh to its bones")
    to_scene = Y_UP_TO_Z_UP @ to_scene
    rest = np.concatenate([to_scene @ binds, Y_UP_TO_Z_UP @ there.frames[len(binds) :]])
    scales = scales_of(rest, lambda i: f"the rest frame of bone {nodes.names[bones[i]]!r}")
    u, _, vt = np.linalg.svd(rest[:, :3, :3] / scales[:, None, None])
    rest[:, :3, :3] = u @ vt  # the nearest rotations: files hold float32
    place = np.argsort(order)
    points, triangles, weights = _skinned_surface(gltf, meshes, len(skin.joints), place)
    points = points @ to_scene[:3, :3].T + to_scene[:3, 3]
    parents = np.array([there.parents[old] for old in order], np.int32)
    parents = np.where(parents >= 0, place[parents], -1).astype(np.int32)
    frames = rest[order]
    skeleton = Skeleton(
        _unique([nodes.names[bones[old]] for old in order]),
        parents,
        frames,
        tails_from(frames[:, :3, 3], parents, points, weights),
    )
    maps = []
    for old in order:
        parent, between = there.parents[old], there.between[old]
        if parent < 0:
            maps.append(_Map(Y_UP_TO_Z_UP @ between, 1.0, scales[old]))
        else:
            maps.append(_Map(between, scales[parent], scales[old]))
    clips = _Clips(gltf, skeleton, [bones[old] for old in order], maps, there.values).read()
    return GltfRig(skeleton, clips, points, triangles, weights, tuple(notes), gltf.copyright)


def _bones(gltf: Gltf, nodes, skin) -> list[int]:
    """The nodes that are bones: the joints of a skin, and what clips move above them."""
    joints = skin.joints
    check(
        0 < len(joints) <= MOST_BONES,
        f"its skin has {len(joints)} joints, not 1 to {MOST_BONES}",
    )
    for joint in joints:
        gltf.at(gltf.root.nodes, joint, "node", "joints")
    check(len(set(joints)) == len(joints), "its skin names a joint twice")
    animated = {c.target.node for a in gltf.root.animations for c in a.channels}
    above = nodes.with_ancestors(joints).difference(joints)
    bones = list(joints) + sorted(above & animated)
    check(len(bones) <= MOST_BONES, f"its skeleton has {len(bones)} bones, over {MOST_BONES}")
    return bones


def _skinned_surface(gltf: Gltf, meshes, joint_count: int, place):
    """Points [S, 3], triangles [N, 3], and dense weights [S, B]; joint j is bone place[j]."""
    points, triangles, joints, weights = surface(gltf, meshes)
    last = joints.max(initial=0)
    check(last < joint_count, f"points are bound to joint {last}, but the skin has {joint_count}")
    check(
        len(points) * len(place) <= MOST_WEIGHTS,
        f"its skin has {len(points)} points and {len(place)} bones; simplify it",
    )
    weights = weights / weights.sum(axis=1, keepdims=True)
    dense = np.zeros((len(points), len(place)), np.float32)
    np.add.at(dense, (np.arange(len(points))[:, None], place[joints]), weights)
    return points, triangles, dense


def tails_from(heads, parents, points, weights) -> np.ndarray:
    """Tails of joints that have none, as glTF's: where a bone's matter is.  [B, 3]

    A bone with one child ends there, one with several at their middle.  A leaf ends twice as far
    from its head as the middle of the points that it moves, or else goes on like its parent.
    """
    count = len(heads)
    tails = np.array(heads, float)
    total = weights.sum(axis=0, dtype=float)
    middles = np.einsum("sb,sx->bx", weights, points, dtype=float)
    middles /= np.maximum(total, 1e-12)[:, None]
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


class _Clips:
    """Reads a file's animations, and counts what they come to before it is made."""

    def __init__(self, gltf: Gltf, skeleton: Skeleton, bone_nodes, maps, values):
        """Bone b is the node bone_nodes[b], whose values by path and node are given."""
        self._gltf, self._maps = gltf, maps
        self._bone_of = {node: bone for bone, node in enumerate(bone_nodes)}
        self._still = self._unmoved(skeleton.rest_pose, bone_nodes, values)
        self._channels = self._keys = 0

    def read(self) -> tuple[Clip, ...]:
        animations = self._gltf.root.animations
        check(len(animations) <= MOST_CLIPS, f"it has {len(animations)} clips, over {MOST_CLIPS}")
        names = [printable_name(a.name, f"clip {i}") for i, a in enumerate(animations)]
        clips = []
        for name, animation in zip(_unique(names), animations, strict=True):
            self._check_once(animation, name)
            channels = [self._channel(animation, entry, name) for entry in animation.channels]
            channels = [channel for channel in channels if channel is not None]
            moving = {(c.bone, c.path) for c in channels}
            rest = [c for c in self._still if (c.bone, c.path) not in moving]
            self._count(len(rest), sum(c.values.size for c in rest))
            last = max((float(c.times[-1]) for c in channels), default=0.0)
            clips.append(Clip(name, last, (*channels, *rest)))
        return tuple(clips)

    def _check_once(self, animation, name: str):
        """ValueError if a clip moves a bone twice: before the keys are made, which takes long."""
        targets = [c.target for c in animation.channels if c.target.node in self._bone_of]
        count = len({(target.node, target.path) for target in targets})
        check(count == len(targets), f"clip {name!r} animates a bone's {'/'.join(PATHS)} twice")

    def _unmoved(self, rest, bone_nodes, values) -> list[Channel]:
        """A key for each node whose own transform differs from the bind pose.

        It counts where a clip does not move the node.
        """
        found = []
        for bone, node in enumerate(bone_nodes):
            for path in PATHS:
                value = np.array(self._maps[bone].values(path, values[path][node]), float)
                still = getattr(rest, f"{path}s")[bone]
                if path == "rotation" and value @ still < 0.0:
                    value = -value
                if np.abs(value - still).max() > 1e-5:
                    found.append(Channel(bone, path, "STEP", np.zeros(1), value[None]))
        return found

    def _channel(self, animation, entry, name: str) -> Channel | None:
        """A channel of a clip; None if it moves no bone: shape keys, cameras, other objects."""
        path, bone = entry.target.path, self._bone_of.get(entry.target.node)
        if path not in PATHS or bone is None:
            return None
        what = f"keys of clip {name!r}"
        sampler = self._gltf.at(animation.samplers, entry.sampler, "sampler", what)
        times = self._gltf.numbers(sampler.input, "SCALAR", f"times of clip {name!r}")
        kind = "VEC4" if path == "rotation" else "VEC3"
        keys = self._gltf.numbers(sampler.output, kind, what)
        self._count(1, keys.size)
        interpolation = sampler.interpolation or "LINEAR"
        if interpolation == "CUBICSPLINE":
            check(len(keys) % 3 == 0, f"the {what} lack tangents")
            keys = keys.reshape(-1, 3, keys.shape[1])
        times, keys = times.astype(float, copy=False), keys.astype(float, copy=False)
        keys = self._maps[bone].keys(path, interpolation, keys)
        return Channel(bone, path, interpolation, times, keys)

    def _count(self, channels: int, keys: int):
        self._channels, self._keys = self._channels + channels, self._keys + keys
        check(
            self._channels <= MOST_CHANNELS and self._keys <= MOST_KEYS,
            f"its clips have more than {MOST_CHANNELS} channels, or {MOST_KEYS} numbers in their "
            "keys; export fewer clips or keys",
        )


def _unique(names) -> tuple[str, ...]:
    """Names, those that come again with a number."""
    found, numbers = {}, {}  # names in their order; the last number of each that came again
    for plain in names:
        name = plain
        while name in found:
            numbers[plain] = numbers.get(plain, 0) + 1
            name = f"{plain}.{numbers[plain]:03}"
        found[name] = None
    return tuple(found)
