"""The nodes of a glTF file: a tree of transforms, of which those at bones and above them count.

N nodes, each under one parent.  Each pass goes through them once, parents first, so that a chain
of all nodes takes no longer than any other tree.
"""

from dataclasses import dataclass

import numpy as np

from ...core.base.schema import check
from . import rotations
from .clips import PATHS
from .gltf_file import Gltf
from .skeleton import LONGEST_NAME, parents_first

MOST_NODES = 2**16
EVEN = 1e-3  # how much scales of a matrix may differ, relative
FARTHEST = 1e6  # of a number of a transform


@dataclass(frozen=True)
class Nodes:
    """The tree."""

    parents: list[int]  # N, -1 for a root
    names: list[str]
    order: list[int]  # parents before their children

    def with_ancestors(self, nodes) -> set[int]:
        """These nodes, and all above them."""
        found = set()
        for node in nodes:
            while node >= 0 and node not in found:
                found.add(node)
                node = self.parents[node]
        return found


@dataclass(frozen=True)
class Placed:
    """Where bones are in the tree.  B bones."""

    values: dict[str, np.ndarray]  # of all nodes, by path: [N, 3], rotations [N, 4]
    parents: list[int]  # B: the bone that is next above each, -1 without one
    between: np.ndarray  # [B, 4, 4] the product of the nodes between, or of all above a root
    frames: np.ndarray  # [B, 4, 4] from each bone's space to that of the scene, at rest


def read_nodes(gltf: Gltf) -> Nodes:
    nodes = gltf.root.nodes
    check(0 < len(nodes) <= MOST_NODES, f"it has {len(nodes)} nodes, not 1 to {MOST_NODES}")
    parents = [-1] * len(nodes)
    for number, node in enumerate(nodes):
        for child in node.children or ():
            gltf.at(nodes, child, "node", f"children of node {number}")
            check(parents[child] < 0, f"node {child} has two parents")
            parents[child] = number
    names = [printable_name(node.name, f"bone {i}") for i, node in enumerate(nodes)]
    return Nodes(parents, names, parents_first(names, parents))  # a cycle ends there


def placed(gltf: Gltf, nodes: Nodes, bones: list[int]) -> Placed:
    """Bones, which are numbers of nodes, with what is between them."""
    used = nodes.with_ancestors(bones)
    values = _values(gltf, sorted(used))
    local = np.tile(np.eye(4), (len(nodes.parents), 1, 1))
    local[:, :3, :3] = rotations.matrix_of(values["rotation"]) * values["scale"][:, None]
    local[:, :3, 3] = values["translation"]
    frames, ways = local.copy(), np.tile(np.eye(4), (len(local), 1, 1))
    number = {bone: i for i, bone in enumerate(bones)}
    owner = [-1] * len(local)  # the bone next above
    for node in nodes.order:
        parent = nodes.parents[node]
        if node not in used or parent < 0:
            continue
        frames[node] = frames[parent] @ local[node]
        owner[node] = number.get(parent, owner[parent])
        if parent not in number:
            ways[node] = ways[parent] @ local[parent]
    return Placed(values, [owner[b] for b in bones], ways[bones], frames[bones])


def _values(gltf: Gltf, used: list[int]) -> dict[str, np.ndarray]:
    """Translations, rotations and scales; those of nodes that are not used are none."""
    nodes = gltf.root.nodes
    values = {path: np.zeros((len(nodes), 4 if path == "rotation" else 3)) for path in PATHS}
    values["rotation"][:, 3], values["scale"][:] = 1.0, 1.0
    for node in used:
        for path in PATHS:
            given = getattr(nodes[node], path)
            if given is not None:
                row, given = values[path][node], np.array(given, float)
                good = given.shape == row.shape
                check(good, f"the {path} of node {node} is no {row.size} numbers")
                row[:] = given
    fixed = [node for node in used if nodes[node].matrix is not None]
    if fixed:
        matrices = np.array([nodes[node].matrix for node in fixed], float).reshape(-1, 4, 4)
        matrices = np.swapaxes(matrices, 1, 2)
        scales = scales_of(matrices, lambda i: f"the matrix of node {fixed[i]}")
        turns = matrices[:, :3, :3] / scales[:, None, None]
        values["rotation"][fixed] = rotations.quaternion_of(turns)
        values["translation"][fixed] = matrices[:, :3, 3]
        values["scale"][fixed] = scales[:, None]
    good = all((np.abs(v) <= FARTHEST).all() for v in values.values())  # NaN fails, too
    check(good, "the transform of a node holds NaN, or numbers beyond 1e6")
    values["rotation"] = rotations.unit(values["rotation"])
    return values


def scale_of(matrix: np.ndarray, whose: str) -> float:
    """The scale of a similarity; ValueError if a matrix is none."""
    matrix = np.asarray(matrix, float)
    check(matrix.shape == (4, 4), f"{whose} is no 4×4 matrix")
    return float(scales_of(matrix[None], lambda _: whose)[0])


def scales_of(matrices: np.ndarray, whose) -> np.ndarray:
    """The scales of similarities [n, 4, 4]; ValueError at the first that is none.  [n]

    Args:
        whose: A function: the number of a matrix to its words in a sentence.
    """
    linear = matrices[:, :3, :3]
    finite = np.isfinite(matrices).all(axis=(1, 2)) & (matrices[:, 3] == [0, 0, 0, 1]).all(axis=1)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        volumes = np.where(finite, np.linalg.det(np.where(finite[:, None, None], linear, 0.0)), 0.0)
        scales = np.cbrt(volumes)
        grams = np.swapaxes(linear, 1, 2) @ linear / (scales**2)[:, None, None]
        even = (np.abs(grams - np.eye(3)) < EVEN).all(axis=(1, 2))  # NaN fails, too
    bad = ~(finite & (volumes > 0.0) & even)
    if bad.any():
        first = int(np.argmax(bad))
        name = whose(first)
        check(finite[first], f"{name} is no finite 4×4 matrix with the last row 0 0 0 1")
        check(
            volumes[first] > 0.0,
            f"{name} mirrors, or flattens (its determinant is {volumes[first]:.3g})",
        )
        raise ValueError(
            f"{name} scales unevenly or shears; apply the scale of object and bones first"
        )
    return scales


def printable_name(name, otherwise: str) -> str:
    """A name of the file as one that bones and clips can have."""
    words = str(name or "")[: LONGEST_NAME - 5]
    return "".join(c if c.isprintable() else "?" for c in words) or otherwise
