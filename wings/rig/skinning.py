"""Vertices that follow bones: linear-blend and dual-quaternion skinning.

x: a rest vertex.  w_b: its weights, sum 1.  M_b = [A_b | t_b]: skinning matrices.

    linear           x' = Σ w_b (A_b x + t_b)                          (what glTF and Blender do)
    dual quaternion  A_b = R_b P_b, a rotation and a stretch (polar decomposition);
                     y = Σ w_b (P_b (x − c_b) + c_b),   c_b: middle of what the bone moves
                     x' = the rigid motion Σ w_b q̂_b / |Σ w_b q_b| of y  (Kavan et al. 2008)
    offsets          o_b with Σ o_b = 0: to either x' comes Σ A_b o_b      (Merry et al. 2006)

A linear blend of two rotations shrinks what lies between them; a blend of dual quaternions is a
rigid motion again.  Quaternions q and −q are one rotation: each bone's sign is that of the bone
of largest weight, for every vertex.

Bones bend what they blend into an arc, but a triangle of a skinned surface stays flat, and its
inside follows chords.  Linear blending with offsets moves each point by Σ M_b (w_b x + o_b, w_b),
which chords are, too (fitting.py).  If all bones move alike, offsets do nothing.

The reference is in float64 over all bones; kernels read the non-zero weights alone, in float32.
Shapes: V vertices, B bones, N non-zero weights.
"""

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from ...core.base.device import start_warp
from ...core.base.feed import Feed
from . import rotations
from .rig import Method, check_method

wp.set_module_options({"enable_backward": False})


def skinned(
    rest_vertices: ArrayLike,
    weights: ArrayLike,
    matrices: ArrayLike,
    method: Method = "linear",
    offsets: ArrayLike | None = None,
) -> np.ndarray:
    """The vertices in a pose: the reference.

    Args:
        rest_vertices: [V, 3].
        weights: [V, B], rows that sum to 1.
        matrices: [B, 4, 4] skinning matrices.
        offsets: [V, B, 3], rows that sum to 0; None: all 0.

    Returns:
        [V, 3] float64.
    """
    check_method(method)
    x, w = np.asarray(rest_vertices, float), np.asarray(weights, float)
    matrices = np.asarray(matrices, float)
    blend = _linear if method == "linear" else _dual_quaternion
    moved = blend(x, w, matrices)
    if offsets is not None:
        moved += np.einsum("bij,vbj->vi", matrices[:, :3, :3], np.asarray(offsets, float))
    return moved


def _linear(x, w, matrices):
    return np.einsum("vb,bvi->vi", w, _moved(matrices, x))


def _dual_quaternion(x, w, matrices):
    turns, duals, stretches = rigid_parts(matrices, centers(x, w))
    y = np.einsum("vb,bvi->vi", w, _moved(stretches, x))
    pivot = turns[np.argmax(w, axis=1)]
    signed = w * np.where(pivot @ turns.T < 0.0, -1.0, 1.0)
    real, dual = signed @ turns, signed @ duals
    length = np.linalg.norm(real, axis=1, keepdims=True)
    real, dual = real / length, dual / length
    return (
        rotations.rotated(real, y) + 2.0 * rotations.product(dual, rotations.inverse(real))[:, :3]
    )


def centers(rest_vertices, weights) -> np.ndarray:
    """The middle of what each bone moves; the origin for bones that move nothing.  [B, 3]"""
    total = np.asarray(weights, float).sum(axis=0)
    sums = np.asarray(weights, float).T @ np.asarray(rest_vertices, float)
    return sums / np.where(total > 0.0, total, 1.0)[:, None]


def rigid_parts(matrices, around):
    """Skinning matrices as rigid motions after stretches about the points `around` [B, 3].

    Returns:
        Unit quaternions [B, 4], dual parts ½ t q [B, 4], stretches [B, 4, 4].
    """
    linear = matrices[:, :3, :3]
    u, sizes, vt = np.linalg.svd(linear)
    mirrored = np.linalg.det(u @ vt) < 0.0
    u[mirrored, :, 2] *= -1.0
    sizes[mirrored, 2] *= -1.0
    turn = u @ vt
    stretch = np.swapaxes(vt, 1, 2) @ (sizes[:, :, None] * vt)
    shift = matrices[:, :3, 3] + np.einsum("bij,bj->bi", linear - turn, around)
    stretches = np.tile(np.eye(4), (len(matrices), 1, 1))
    stretches[:, :3, :3] = stretch
    stretches[:, :3, 3] = around - np.einsum("bij,bj->bi", stretch, around)
    turns = rotations.quaternion_of(turn)
    duals = 0.5 * rotations.product(np.pad(shift, ((0, 0), (0, 1))), turns)
    return turns, duals, stretches


def _moved(matrices, points):
    """Each point by each matrix.  [B, V, 3]"""
    return np.einsum("bij,vj->bvi", matrices[:, :3, :3], points) + matrices[:, None, :3, 3]


@wp.kernel
def linear_kernel(
    rest_vertices: wp.array(dtype=wp.vec3),
    starts: wp.array(dtype=int),  # [V + 1] vertex v has the entries starts[v]:starts[v + 1]
    bones: wp.array(dtype=int),  # [N]
    weights: wp.array(dtype=float),  # [N]
    matrices: wp.array(dtype=wp.mat44),  # [B]
    vertices: wp.array(dtype=wp.vec3),
):
    v = wp.tid()
    x = rest_vertices[v]
    blended = wp.vec3(0.0)
    for n in range(starts[v], starts[v + 1]):
        blended += weights[n] * wp.transform_point(matrices[bones[n]], x)
    vertices[v] = blended


@wp.kernel
def dual_quaternion_kernel(
    rest_vertices: wp.array(dtype=wp.vec3),
    starts: wp.array(dtype=int),
    bones: wp.array(dtype=int),
    weights: wp.array(dtype=float),
    matrices: wp.array(dtype=wp.mat44),  # [B] the stretches
    turns: wp.array(dtype=wp.quat),  # [B]
    duals: wp.array(dtype=wp.quat),  # [B]
    vertices: wp.array(dtype=wp.vec3),
):
    v = wp.tid()
    x = rest_vertices[v]
    y = wp.vec3(0.0)
    real = wp.quat(0.0, 0.0, 0.0, 0.0)
    dual = wp.quat(0.0, 0.0, 0.0, 0.0)
    largest = float(0.0)
    pivot = int(0)
    for n in range(starts[v], starts[v + 1]):
        y += weights[n] * wp.transform_point(matrices[bones[n]], x)
        if weights[n] > largest:  # the first of equals, as argmax in the reference
            largest = weights[n]
            pivot = bones[n]
    for n in range(starts[v], starts[v + 1]):
        q = turns[bones[n]]
        w = weights[n]
        if wp.dot(q, turns[pivot]) < 0.0:
            w = -w
        real += w * q
        dual += w * duals[bones[n]]
    length = wp.length(real)
    real = real / length
    dual = dual / length
    shift = dual * wp.quat_inverse(real)
    vertices[v] = wp.quat_rotate(real, y) + 2.0 * wp.vec3(shift[0], shift[1], shift[2])


@wp.kernel
def offset_kernel(
    starts: wp.array(dtype=int),
    bones: wp.array(dtype=int),
    offsets: wp.array(dtype=wp.vec3),  # [N]
    matrices: wp.array(dtype=wp.mat44),  # [B]
    vertices: wp.array(dtype=wp.vec3),  # changed
):
    v = wp.tid()
    moved = vertices[v]
    for n in range(starts[v], starts[v + 1]):
        moved += wp.transform_vector(matrices[bones[n]], offsets[n])
    vertices[v] = moved


class Skinner:
    """The vertices of one object, posed on a device.

    Attributes:
        vertices: Where `pose` writes.  [V] wp.vec3
    """

    def __init__(
        self,
        rest_vertices: np.ndarray,
        weights: np.ndarray,
        device: str,
        offsets: np.ndarray | None = None,
    ):
        """Take vertices [V, 3], weights [V, B], and offsets [V, B, 3] that are 0 where those are.

        Without offsets (None) posing costs nothing for them.
        """
        start_warp()
        x, w = np.asarray(rest_vertices, float), np.asarray(weights, float)
        vertex, bone = np.nonzero(w)
        starts = np.searchsorted(vertex, np.arange(len(x) + 1))

        def on_device(values, dtype):
            return wp.array(values, dtype=dtype, device=device)

        self.device = device
        self.vertices = wp.empty(len(x), dtype=wp.vec3, device=device)
        self._middles = centers(x, w)
        self._fixed = (
            on_device(x, wp.vec3),
            on_device(starts, int),
            on_device(bone, int),
            on_device(w[vertex, bone], float),
        )
        self._offsets = None if offsets is None else on_device(offsets[vertex, bone], wp.vec3)
        dtypes = {"matrices": wp.mat44, "stretches": wp.mat44, "turns": wp.quat, "duals": wp.quat}
        self._of_bones = {
            name: wp.empty(w.shape[1], dtype=dtype, device=device) for name, dtype in dtypes.items()
        }
        self._feeds = {name: Feed(array) for name, array in self._of_bones.items()}
        self._launches = {}  # of the methods

    def pose(self, matrices: np.ndarray, method: Method = "linear") -> wp.array:
        """The vertices for skinning matrices [B, 4, 4]; the same array each time."""
        check_method(method)
        values = {"matrices": np.asarray(matrices, float)}
        if method == "dual quaternion":
            turns, duals, stretches = rigid_parts(values["matrices"], self._middles)
            values |= {"stretches": stretches, "turns": turns, "duals": duals}
        for name, numbers in values.items():
            self._feeds[name].put(numbers)
        if method not in self._launches:
            self._launches[method] = self._launches_of(method)
        for launch in self._launches[method]:
            launch.launch()
        return self.vertices

    def _launches_of(self, method):
        """The launches of a method: arrays are always the same, and a recorded launch is fast."""
        of, (_, starts, bones, _) = self._of_bones, self._fixed
        kernel, inputs = linear_kernel, [of["matrices"]]
        if method == "dual quaternion":
            kernel = dual_quaternion_kernel
            inputs = [of["stretches"], of["turns"], of["duals"]]
        launches = [(kernel, [*self._fixed, *inputs])]
        if self._offsets is not None:
            launches.append((offset_kernel, [starts, bones, self._offsets, of["matrices"]]))
        count, how = len(self.vertices), {"device": self.device, "record_cmd": True}
        return [wp.launch(one, count, [*inputs, self.vertices], **how) for one, inputs in launches]
