"""The skin of a glTF file: which joints it has, their bind matrices, and the points it moves.

Shapes: S points, N triangles, W weights of a point.
"""

import numpy as np

from .gltf_file import Gltf, check

MOST_POINTS = 2**18
SUM_ERROR = 0.02  # of a point's weights from 1, in files
TRIANGLES = 4  # glTF's number of that primitive


def chosen_skin(gltf: Gltf):
    """The skin with the most points, and the meshes that it moves."""
    parts, found = gltf.parts, {}
    for node in parts.nodes:
        if node.skin is not None and node.mesh is not None:
            mesh = gltf.at(parts.meshes, node.mesh, "mesh", "points")
            found.setdefault(node.skin, []).append(mesh)
    check(found, "it has no mesh that is bound to bones (no skin)")

    def size(skin):
        primitives = (p for mesh in found[skin] for p in mesh.primitives)
        return sum(
            gltf.at(parts.accessors, p.attributes.POSITION, "accessor", "points").count
            for p in primitives
        )

    best = max(sorted(found), key=size)
    return gltf.at(parts.skins, best, "skin", "bones"), found[best]


def surface(gltf: Gltf, meshes):
    """Points [S, 3], triangles [N, 3], and joints and weights of each point [S, W]."""
    parts = []
    for primitive in (p for mesh in meshes for p in mesh.primitives):
        if primitive.mode not in (None, TRIANGLES):
            continue
        attributes = vars(primitive.attributes)
        points = gltf.numbers(attributes.get("POSITION"), "VEC3", "points").astype(float)
        sets = [k for k in range(8) if attributes.get(f"JOINTS_{k}") is not None]
        check(sets, "a part of its skinned mesh has no weights")
        joints, weights = (
            np.concatenate([gltf.numbers(attributes.get(f"{n}_{k}"), "VEC4", w) for k in sets], 1)
            for n, w in (("JOINTS", "joints of points"), ("WEIGHTS", "weights of points"))
        )
        indices = np.arange(len(points))
        if primitive.indices is not None:
            indices = gltf.numbers(primitive.indices, "SCALAR", "triangles")
        check(len(joints) == len(points) == len(weights), "it has not as many weights as points")
        check(len(points) > 0 and len(indices) % 3 == 0, "its triangles are incomplete")
        check(
            indices.max(initial=0) < len(points) and indices.dtype.kind == "i",
            f"a triangle has the point {indices.max(initial=0)} of {len(points)}",
        )
        check(joints.dtype.kind == "i", "joints of points are no whole numbers")
        parts.append((points, indices.reshape(-1, 3), joints, weights))
    check(parts, "its skinned mesh has no triangles")
    width = max(part[2].shape[1] for part in parts)
    starts = np.cumsum([0] + [len(part[0]) for part in parts])
    points = np.concatenate([part[0] for part in parts])
    triangles = np.concatenate([p[1] + s for p, s in zip(parts, starts, strict=False)])
    joints, weights = (
        np.concatenate([np.pad(p[i], ((0, 0), (0, width - p[i].shape[1]))) for p in parts])
        for i in (2, 3)
    )
    check(len(points) <= MOST_POINTS, f"its skin has {len(points)} points; simplify it")
    check(np.abs(points).max() <= 1e6, "its points are farther than 1e6 from the origin")
    sums = weights.sum(axis=1)
    wrong = ~(np.abs(sums - 1.0) <= SUM_ERROR) | (weights < 0.0).any(axis=1)
    if wrong.any():
        first = int(np.argmax(wrong))
        raise ValueError(
            f"the weights of point {first} sum to {sums[first]:.3g}, not 1, or are negative; "
            "normalize the weights"
        )
    return points, triangles.astype(np.int32), joints, weights


def bind_matrices(gltf: Gltf, skin) -> list:
    """The bind matrix of each joint."""
    if skin.inverseBindMatrices is None:
        return [np.eye(4) for _ in skin.joints]
    inverse = gltf.numbers(skin.inverseBindMatrices, "MAT4", "bind matrices").reshape(-1, 4, 4)
    check(
        len(inverse) >= len(skin.joints),
        f"its skin has {len(skin.joints)} joints, but {len(inverse)} bind matrices",
    )
    inverse = np.swapaxes(inverse, 1, 2)[: len(skin.joints)]  # stored by columns
    flat = ~(np.abs(np.linalg.det(inverse[:, :3, :3])) > 1e-12)
    check(not flat.any(), f"bind matrix {int(np.argmax(flat))} is flat")
    inverse[:, 3] = (0.0, 0.0, 0.0, 1.0)  # float32 of other programs
    return list(np.linalg.inv(inverse))
