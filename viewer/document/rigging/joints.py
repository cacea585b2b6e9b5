"""Joints: the ends of bones, as a hand places, moves and deletes them.

A joint is the tail of a bone, or the head of one that doesn't begin at its parent's tail.  A
chain is begun by a joint without a bone, the *loose* one; the next joint makes a bone of both.
Places are at rest, in model space.  B bones.
"""

from dataclasses import dataclass, replace

import numpy as np

from ....wings.rig import Skeleton, make_skeleton

HEAD, TAIL = ENDS = "head", "tail"
LOOSE = -1  # the bone of the joint that has none


@dataclass(frozen=True, eq=False)
class Joint:
    """One end of a bone."""

    bone: int  # LOOSE: of none yet
    end: str  # of ENDS
    place: np.ndarray  # [3]

    @property
    def name(self) -> tuple[int, str]:
        """What it is chosen by."""
        return self.bone, self.end


def joints_of(skeleton: Skeleton | None, loose=None, heads=None, tails=None) -> list[Joint]:
    """All joints; they are at rest, or where the bones' heads and tails [B, 3] are now."""
    found = [] if loose is None else [Joint(LOOSE, HEAD, np.asarray(loose, float))]
    if skeleton is None:
        return found
    heads = skeleton.heads if heads is None else heads
    tails = skeleton.tails if tails is None else tails
    joined = skeleton.joined
    for bone in range(skeleton.bone_count):
        found.append(Joint(bone, TAIL, tails[bone]))
        if not joined[bone]:
            found.append(Joint(bone, HEAD, heads[bone]))
    return found


def joint_mask(skeleton: Skeleton | None) -> np.ndarray:
    """Which heads and tails are joints of their own.  [B, 2] bool"""
    if skeleton is None:
        return np.zeros((0, 2), bool)
    mask = np.ones((skeleton.bone_count, 2), bool)
    mask[:, 0] = ~skeleton.joined
    return mask


def with_bone(skeleton: Skeleton | None, parent: int, head, tail) -> Skeleton:
    """The skeleton with one more bone, its last."""
    count = 0 if skeleton is None else skeleton.bone_count
    if not -1 <= parent < count:
        raise ValueError(f"there is no bone {parent}")
    one = make_skeleton([_free_name(skeleton)], [-1], [head], [tail])
    if skeleton is None:
        return one
    return Skeleton(
        (*skeleton.names, *one.names),
        np.append(skeleton.parents, parent).astype(np.int32),
        np.concatenate([skeleton.rest, one.rest]),
        np.concatenate([skeleton.tails, one.tails]),
    )


def _free_name(skeleton):
    taken = () if skeleton is None else skeleton.names
    return next(n for k in range(1, len(taken) + 2) if (n := f"bone {k}") not in taken)


def moved(skeleton: Skeleton, bone: int, end: str, to) -> Skeleton:
    """The skeleton with a joint elsewhere; bones that begin there go along."""
    heads, tails = skeleton.heads.copy(), skeleton.tails.copy()
    changed = [bone]
    if end == TAIL:
        tails[bone] = to
        joined = skeleton.joined
        children = [c for c in skeleton.children[bone] if joined[c]]
        heads[children] = to
        changed += children
    else:
        heads[bone] = to
    return _redrawn(skeleton, changed, heads, tails)


def _redrawn(skeleton, changed, heads, tails):
    """The skeleton with new frames for the bones whose ends have changed."""
    rest = skeleton.rest.copy()
    names = [skeleton.names[bone] for bone in changed]
    fresh = make_skeleton(names, [-1] * len(changed), heads[changed], tails[changed])
    rest[changed] = fresh.rest
    return replace(skeleton, rest=rest, tails=tails)


def without_joint(skeleton: Skeleton, bone: int, end: str) -> Skeleton | None:
    """The skeleton without a bone; what hung on it hangs on its parent.  None if none is left.

    Without a bone's tail, bones that began there begin at its head; without its head, they
    begin where they did.
    """
    children = skeleton.children[bone]
    if end == TAIL:
        joined = skeleton.joined
        at_tail = [c for c in children if joined[c]]
        heads = skeleton.heads.copy()
        heads[at_tail] = skeleton.heads[bone]
        skeleton = _redrawn(skeleton, at_tail, heads, skeleton.tails) if at_tail else skeleton
    if skeleton.bone_count == 1:
        return None
    parents = skeleton.parents.copy()
    parents[list(children)] = parents[bone]
    kept = np.arange(skeleton.bone_count) != bone
    parents = np.where(parents > bone, parents - 1, parents)[kept]
    names = tuple(name for b, name in enumerate(skeleton.names) if b != bone)
    return Skeleton(names, parents.astype(np.int32), skeleton.rest[kept], skeleton.tails[kept])


def renamed(skeleton: Skeleton, bone: int, name: str) -> Skeleton:
    """The skeleton with another name of a bone; a ValueError if another one has it."""
    names = list(skeleton.names)
    names[bone] = name
    return replace(skeleton, names=tuple(names))
