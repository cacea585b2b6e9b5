"""The skin of a glTF file: which joints it has, their bind matrices, and the points it moves.

Shapes: S points, N triangles, W weights of a point.
"""

import numpy as np

from ...core.base.schema import check
from .gltf_file import Gltf, JsonObject

MOST_POINTS = 2**18
MOST_TRIANGLES = 2**20
MOST_PRIMITIVES = 2**12
SUM_ERROR = 0.02  # of a point's weights from 1, in files
TRIANGLES = 4  # glTF's number of that primitive


def chosen_skin(gltf: Gltf):
    """The skin with the most points, the meshes that it moves, and sentences on what is left out.

    Returns:
        The skin, its meshes, each once, and a list of sentences.
    """
    root, found, sizes = gltf.root, {}, {}
    for node in root.nodes:
        if node.skin is not None and node.mesh is not None:
            gltf.at(root.skins, node.skin, "skin", "bones")
            mesh = gltf.at(root.meshes, node.mesh, "mesh", "points")
            found.setdefault(node.skin, {})[node.mesh] = mesh
            if node.mesh not in sizes:
                counts = (gltf.count(p.attributes.POSITION, "points") for p in solid(mesh))
                sizes[node.mesh] = sum(counts)
    check(found, "it has no mesh that is bound to bones (no skin)")
    points = {skin: sum(map(sizes.get, meshes)) for skin, meshes in found.items()}
    best = max(sorted(found), key=points.get)
    check(points[best] <= MOST_POINTS, f"its skin has {points[best]} points; simplify it")
    notes = []
    if len(found) > 1:
        name = str(root.skins[best].name or f"number {best}")[:60]
        notes.append(
            f"It has {len(found)} skins: {name}, with the most points ({points[best]}), is taken, "
            "and the others are left out; join their meshes to bind them all."
        )
    notes += _shape_notes(gltf, best, found[best])
    return root.skins[best], list(found[best].values()), notes


def solid(mesh: JsonObject) -> list[JsonObject]:
    """The primitives of a mesh that are triangles."""
    return [p for p in mesh.primitives if p.mode in (None, TRIANGLES)]


def _shape_notes(gltf: Gltf, skin: int, meshes: dict) -> list[str]:
    """A sentence if shape keys of the meshes (glTF: morph targets) change what is seen."""
    users = [(k, n) for k, n in enumerate(gltf.root.nodes) if n.skin == skin and n.mesh in meshes]
    own = {node.mesh for _, node in users if node.weights is None}
    lists = [node.weights or () for _, node in users] + [meshes[k].weights or () for k in own]
    largest = max((abs(float(w)) for weights in lists for w in weights), default=0.0)
    nodes = {number for number, _ in users}
    clips = sum(
        any(c.target.path == "weights" and c.target.node in nodes for c in animation.channels)
        for animation in gltf.root.animations
    )
    what = [f"with weights up to {largest:.3g} at rest"] * (largest > 0.0)
    what += [f"that {clips} of its clips move"] * (clips > 0)
    if not what:
        return []
    said = ", and ".join(what)
    return [f"It has morph targets {said}: they are left out, and bones alone are taken."]


def surface(gltf: Gltf, meshes):
    """Points [S, 3], triangles [N, 3], and joints and weights of each point [S, W]."""
    primitives = [primitive for mesh in meshes for primitive in solid(mesh)]
    count = len(primitives)
    check(count <= MOST_PRIMITIVES, f"its skin has {count} meshes or materials; join them")
    corners = sum(gltf.count(p.indices, "triangles") for p in primitives if p.indices is not None)
    check(corners <= 3 * MOST_TRIANGLES, f"its skin has {corners // 3} triangles; simplify it")
    found = [_primitive(gltf, primitive) for primitive in primitives]
    check(found, "its skinned mesh has no triangles")
    width = max(one[2].shape[1] for one in found)
    starts = np.cumsum([0] + [len(one[0]) for one in found])
    points = np.concatenate([one[0] for one in found])
    triangles = np.concatenate([p[1] + s for p, s in zip(found, starts, strict=False)])
    joints, weights = (
        np.concatenate([np.pad(p[i], ((0, 0), (0, width - p[i].shape[1]))) for p in found])
        for i in (2, 3)
    )
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


def _primitive(gltf: Gltf, primitive: JsonObject):
    """Points, triangles, joints and weights of a primitive."""
    attributes = vars(primitive.attributes)
    points = gltf.numbers(attributes.get("POSITION"), "VEC3", "points").astype(float, copy=False)
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
    check(min(joints.min(), indices.min(initial=0)) >= 0, "joints or triangles are below 0")
    return points, indices.reshape(-1, 3), joints, weights


def bind_matrices(gltf: Gltf, skin: JsonObject) -> np.ndarray:
    """The bind matrix of each joint.  [joints, 4, 4]"""
    count = len(skin.joints)
    if skin.inverseBindMatrices is None:
        return np.tile(np.eye(4), (count, 1, 1))
    inverse = gltf.numbers(skin.inverseBindMatrices, "MAT4", "bind matrices").reshape(-1, 4, 4)
    check(
        len(inverse) >= count,
        f"its skin has {count} joints, but {len(inverse)} bind matrices",
    )
    inverse = np.swapaxes(inverse, 1, 2)[:count].astype(float)  # stored by columns
    flat = ~(np.abs(np.linalg.det(inverse[:, :3, :3])) > 1e-12)
    check(not flat.any(), f"bind matrix {int(np.argmax(flat))} is flat")
    inverse[:, 3] = (0.0, 0.0, 0.0, 1.0)  # float32 of other programs
    return np.linalg.inv(inverse)
