"""A skeleton, its poses, and what a hand does to them: turn a bone, reach with two.

A bone is a joint, its *head*, and a *tail* to draw it to.  Its *frame* is a 4×4 matrix from the
bone's own space to model space.  B bones; a parent comes before its children.

    F_b = F_parent(b) · T_b · R_b · S_b      the frame in a pose, from local values as in glTF
    M_b = F_b · rest_b⁻¹                     the skinning matrix: from rest to the pose
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from . import rotations

MOST_BONES = 1024
LONGEST_NAME = 100  # characters
RIGID = 1e-4  # how far the rotation of a rest frame may be from orthogonal
FARTHEST = 1e6  # of a head or tail from the origin
JOINED = 1e-6  # a head so near to its parent's tail is the same joint [model units]


@dataclass(frozen=True)
class Skeleton:
    """Bones at rest.

    Raises:
        ValueError: The arrays are no skeleton; one sentence.
    """

    names: tuple[str, ...]  # B, unique
    parents: np.ndarray  # [B] int32, -1 for a root; lower than the bone itself
    rest: np.ndarray  # [B, 4, 4] float64, rigid: the bone's space to model space at rest
    tails: np.ndarray  # [B, 3] float64, model space

    def __post_init__(self):
        count = len(self.names)
        if not 1 <= count <= MOST_BONES:
            raise ValueError(f"the skeleton has {count} bones; it needs 1 to {MOST_BONES}")
        shapes = {"parents": (count,), "rest": (count, 4, 4), "tails": (count, 3)}
        for name, shape in shapes.items():
            found = np.shape(getattr(self, name))
            if found != shape:
                raise ValueError(f"the skeleton's {name} are {list(found)}, not {list(shape)}")
        _check_names(self.names)
        for bone, parent in enumerate(self.parents.tolist()):
            if not -1 <= parent < bone:
                raise ValueError(
                    f"the parent of bone {self.names[bone]!r} is number {parent}; a parent has "
                    "to come before its children, and no bone may be its own ancestor"
                )
        _check_rest(self)

    @property
    def bone_count(self) -> int:
        return len(self.names)

    @property
    def heads(self) -> np.ndarray:
        """Where the bones' joints are, model space.  [B, 3]"""
        return self.rest[:, :3, 3]

    @cached_property
    def locals(self) -> np.ndarray:
        """Rest frames relative to the parents'.  [B, 4, 4]"""
        frames = self.rest.copy()
        child = self.parents >= 0
        frames[child] = rigid_inverse(self.rest[self.parents[child]]) @ self.rest[child]
        return frames

    @cached_property
    def rest_pose(self) -> "BonePose":
        return BonePose(
            self.locals[:, :3, 3].copy(),
            rotations.quaternion_of(self.locals[:, :3, :3]),
            np.ones((self.bone_count, 3)),
        )

    @cached_property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """The children of each bone."""
        lists = [[] for _ in self.names]
        for bone, parent in enumerate(self.parents.tolist()):
            if parent >= 0:
                lists[parent].append(bone)
        return tuple(map(tuple, lists))

    @cached_property
    def joined(self) -> np.ndarray:
        """Whether bones' heads are their parents' tails.  [B] bool"""
        away = self.heads - self.tails[self.parents]
        return (self.parents >= 0) & (np.linalg.norm(away, axis=1) <= JOINED)

    @cached_property
    def inverse_rest(self) -> np.ndarray:
        """From model space to the bones' own at rest.  [B, 4, 4]"""
        return rigid_inverse(self.rest)

    @cached_property
    def _generations(self):
        """Bones that have as many ancestors, and their parents; roots are left out."""
        depth = []
        for parent in self.parents.tolist():
            depth.append(0 if parent < 0 else depth[parent] + 1)
        bones = [np.flatnonzero(np.array(depth) == k) for k in range(1, max(depth) + 1)]
        return [(some, self.parents[some]) for some in bones]

    def bone(self, name: str) -> int:
        """The number of the bone of that name; ValueError without one."""
        if name not in self.names:
            raise ValueError(f"the skeleton has no bone {name!r}; it has {', '.join(self.names)}")
        return self.names.index(name)


@dataclass(frozen=True)
class BonePose:
    """Where the bones are, each relative to its parent, as glTF's nodes have it."""

    translations: np.ndarray  # [B, 3]
    rotations: np.ndarray  # [B, 4] unit quaternions (x, y, z, w)
    scales: np.ndarray  # [B, 3]


def make_skeleton(
    names: Sequence[str], parents: Sequence[int], heads: ArrayLike, tails: ArrayLike
) -> Skeleton:
    """A skeleton from joints alone; each bone's y-axis points from head to tail, as in Blender."""
    heads, tails = np.array(heads, float), np.array(tails, float)
    along = tails - heads
    along[np.linalg.norm(along, axis=1) < 1e-9] = (0.0, 0.0, 1.0)
    rest = np.tile(np.eye(4), (len(heads), 1, 1))
    rest[:, :3, :3] = rotations.matrix_of(rotations.between((0.0, 1.0, 0.0), along))
    rest[:, :3, 3] = heads
    return Skeleton(tuple(names), np.array(parents, np.int32), rest, tails)


def parents_first(names: Sequence[str], parents: Sequence[int]) -> list[int]:
    """An order of bones in which parents precede their children.

    Raises:
        ValueError: A parent does not exist, or bones are each other's ancestors.
    """
    order, placed = [], set()
    for first in range(len(names)):
        chain, bone = {}, first  # in order
        while bone >= 0 and bone not in placed:
            if bone in chain:
                raise ValueError(f"bone {names[bone]!r} is its own ancestor")
            chain[bone] = None
            child, bone = bone, parents[bone]
            if bone >= len(names):
                raise ValueError(f"the parent of bone {names[child]!r} does not exist")
        order += reversed(chain)
        placed.update(chain)
    return order


def posed(skeleton: Skeleton, pose: BonePose) -> np.ndarray:
    """The bones' frames in model space.  [B, 4, 4]"""
    frames = np.zeros((len(pose.translations), 4, 4))  # T·R·S of each bone
    frames[:, :3, :3] = rotations.matrix_of(pose.rotations) * pose.scales[:, None, :]
    frames[:, :3, 3], frames[:, 3, 3] = pose.translations, 1.0
    for bones, parents in skeleton._generations:
        frames[bones] = frames[parents] @ frames[bones]
    return frames


def skinning_matrices(skeleton: Skeleton, pose: BonePose) -> np.ndarray:
    """From rest to the pose, for each bone.  [B, 4, 4]"""
    return posed(skeleton, pose) @ skeleton.inverse_rest


def posed_tails(skeleton: Skeleton, pose: BonePose) -> np.ndarray:
    """The bones' tails in model space.  [B, 3]"""
    return moved_tails(skeleton, skinning_matrices(skeleton, pose))


def moved_tails(skeleton: Skeleton, matrices: np.ndarray) -> np.ndarray:
    """The bones' tails after skinning matrices [B, 4, 4].  [B, 3]"""
    return np.einsum("bij,bj->bi", matrices[:, :3, :3], skeleton.tails) + matrices[:, :3, 3]


def pose_of(skeleton: Skeleton, frames: np.ndarray) -> BonePose:
    """The pose of given frames [B, 4, 4].

    A local matrix that shears (a child that turns within a bone scaled unevenly) loses the
    shear.
    """
    local = np.array(frames, float)
    child = skeleton.parents >= 0
    local[child] = np.linalg.inv(local[skeleton.parents[child]]) @ local[child]
    scales = np.linalg.norm(local[:, :3, :3], axis=1)
    scales[:, 0] *= np.sign(np.linalg.det(local[:, :3, :3]))  # a mirrored bone stays mirrored
    turns = local[:, :3, :3] / np.where(np.abs(scales) > 1e-12, scales, 1.0)[:, None, :]
    return BonePose(local[:, :3, 3].copy(), rotations.quaternion_of(turns), scales)


def mixed(first: BonePose, second: BonePose, share: float) -> BonePose:
    """From the first pose (share 0) to the second (share 1)."""
    return BonePose(
        (1.0 - share) * first.translations + share * second.translations,
        rotations.slerp(first.rotations, second.rotations, np.full(len(first.scales), share)),
        (1.0 - share) * first.scales + share * second.scales,
    )


def turned(skeleton: Skeleton, pose: BonePose, bone: int, rotation: ArrayLike) -> BonePose:
    """The pose with one bone, and all that hangs on it, turned about the bone's head.

    Args:
        rotation: Axis times angle [radians], in model space.  [3]
    """
    around = rotations.IDENTITY  # of the parent, in model space
    ancestor = int(skeleton.parents[bone])
    while ancestor >= 0:
        around = rotations.product(pose.rotations[ancestor], around)
        ancestor = int(skeleton.parents[ancestor])
    turn = rotations.product(rotations.inverse(around), rotations.of_vector(rotation))
    turn = rotations.product(turn, around)
    quaternions = pose.rotations.copy()
    quaternions[bone] = rotations.unit(rotations.product(turn, quaternions[bone]))
    return BonePose(pose.translations, quaternions, pose.scales)


def reach(skeleton: Skeleton, pose: BonePose, bone: int, target: ArrayLike) -> BonePose:
    """The pose in which the bone's tail is at `target` [3], or as near as it can be.

    Two-bone inverse kinematics in closed form: the parent and the bone form a triangle whose
    sides are known, so the cosine theorem gives the angle between them; it is set in the plane
    in which the limb already bends.  A root aims alone.
    """
    target = np.asarray(target, float)
    upper = int(skeleton.parents[bone])
    if upper >= 0:
        heads = posed(skeleton, pose)[:, :3, 3]
        a, b, c = heads[upper], heads[bone], posed_tails(skeleton, pose)[bone]
        upper_length, lower_length = np.linalg.norm(b - a), np.linalg.norm(c - b)
        if min(upper_length, lower_length) > 1e-9:
            wanted = np.clip(
                np.linalg.norm(target - a),
                abs(upper_length - lower_length) + 1e-9,
                upper_length + lower_length - 1e-9,
            )
            cosine = upper_length**2 + lower_length**2 - wanted**2
            cosine /= 2.0 * upper_length * lower_length
            inner = np.arccos(np.clip(cosine, -1.0, 1.0))
            now = _angle(a - b, c - b)
            axis = _bend_axis(a - b, c - b)
            pose = turned(skeleton, pose, bone, (inner - now) * axis)
            return _aimed(skeleton, pose, upper, bone, target)
    return _aimed(skeleton, pose, bone, bone, target)


def rigid_inverse(frames):
    """The inverse of rotations with translations.  [..., 4, 4]"""
    back = np.zeros_like(frames)
    turn = np.swapaxes(frames[..., :3, :3], -1, -2)
    back[..., :3, :3] = turn
    back[..., :3, 3] = -np.einsum("...ij,...j->...i", turn, frames[..., :3, 3])
    back[..., 3, 3] = 1.0
    return back


def _angle(u, v) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))


def _bend_axis(u, v):
    """The unit axis about which v turns away from u; any axis across u for a straight limb."""
    axis = np.cross(u, v)
    if np.linalg.norm(axis) < 1e-9 * np.linalg.norm(u) * np.linalg.norm(v):
        axis = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
    return axis / np.linalg.norm(axis)


def _aimed(skeleton, pose, pivot, bone, target) -> BonePose:
    """The pose with `pivot` turned so that it sees the tail of `bone` where the target is."""
    head = posed(skeleton, pose)[pivot, :3, 3]
    now, wanted = posed_tails(skeleton, pose)[bone] - head, target - head
    if min(np.linalg.norm(now), np.linalg.norm(wanted)) < 1e-9:
        return pose
    turn = rotations.between(now, wanted)
    sine = np.linalg.norm(turn[:3])
    if sine < 1e-15:
        return pose
    return turned(skeleton, pose, pivot, 2.0 * np.arctan2(sine, turn[3]) * turn[:3] / sine)


def check_name(name: str, what: str):
    """ValueError unless a name has 1 to LONGEST_NAME printable characters."""
    if not (isinstance(name, str) and 0 < len(name) <= LONGEST_NAME and name.isprintable()):
        raise ValueError(
            f"a {what}'s name is {str(name)[:LONGEST_NAME]!r}; it has to have 1 to "
            f"{LONGEST_NAME} printable characters"
        )


def _check_names(names):
    for name in names:
        check_name(name, "bone")
    if len(set(names)) < len(names):
        twice = next(name for i, name in enumerate(names) if name in names[:i])
        raise ValueError(f"two bones have the name {twice!r}")


def _check_rest(skeleton: Skeleton):
    for what, values in (("rest frame", skeleton.rest), ("tail", skeleton.tails)):
        flat = values.reshape(skeleton.bone_count, -1)
        good = (np.abs(flat) <= FARTHEST).all(axis=1)  # NaN fails, too
        if not good.all():
            name = skeleton.names[int(np.argmin(good))]
            raise ValueError(
                f"the {what} of bone {name!r} holds NaN, or a number beyond {FARTHEST:g}"
            )
    turns = skeleton.rest[:, :3, :3]
    error = np.abs(np.swapaxes(turns, 1, 2) @ turns - np.eye(3)).max(axis=(1, 2))
    rigid = (error < RIGID) & (np.linalg.det(turns) > 0.0)
    rigid &= (skeleton.rest[:, 3] == (0.0, 0.0, 0.0, 1.0)).all(axis=1)
    if not rigid.all():
        name = skeleton.names[int(np.argmin(rigid))]
        raise ValueError(f"the rest frame of bone {name!r} is no rotation with a translation")
