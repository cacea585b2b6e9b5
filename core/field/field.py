"""A radiance field on a tetrahedral mesh: the contents of a model file.

Every vertex of the coarse mesh has an integer rest address.  Tables give features to the addresses
of `level_count` nested levels, and two networks compute density and color from features.  A field
contains only the rest shape; the renderer has the current vertices.
"""

from dataclasses import dataclass, field, fields, is_dataclass
from functools import cached_property
from itertools import pairwise, starmap
from typing import Any

import numpy as np

from ..base.streams import printable
from ..definition.networks import Field as DefinedField
from ..geometry import TetMesh
from .grid import Surroundings
from .layout import FEATURES, Layout, encoding_of, make_layout
from .networks.basis import BASIS_COUNT
from .networks.shapes import GEOMETRY_FEATURES, Layers


@dataclass(frozen=True)
class FieldOptions:
    """The shape of a field: its arrays' sizes and meaning follow from it."""

    level_count: int = 6  # nested levels, the coarse mesh included (the paper's L = 6)
    table_size: int = 2**18  # entries of a hashed level, T_h; a power of two
    density_hidden: tuple[int, ...] = (64,)  # widths of the network's hidden layers
    color_hidden: tuple[int, ...] = (64, 64)
    march_step: float = 0.002  # Δ, the rest length of a quadrature piece, in model units
    # If color does not depend on the direction, the color network's weights for all but the
    # constant spherical harmonic are zero.
    view_dependence: bool = True
    # One color a ray: the color network takes the means of h and rest directions along it.
    deferred: bool = False
    dense_levels: bool = True  # an entry per vertex where they fit the table; else all are hashed


@dataclass(frozen=True)
class TetField:
    """A trained field."""

    mesh: TetMesh  # at rest, in model space, the unit cube
    neighbours: np.ndarray  # [T, 4] int32: the tet across each face
    occupancy: np.ndarray  # [T] uint64: bit p is set if sub-tet p may hold density
    layout: Layout
    table: np.ndarray  # [entries, F] float32: features of all levels, one after another
    density_layers: Layers
    color_layers: Layers
    options: FieldOptions
    world_to_model: np.ndarray  # [4, 4] similarity from the data's space
    meta: dict[str, Any] = field(default_factory=dict)  # JSON: `training` in docs/model-format.md
    surroundings: Surroundings | None = None
    stiffness: np.ndarray | None = None  # [V] factors of Young's modulus; None: 1 everywhere
    rig_arrays: dict[str, np.ndarray] | None = None  # of a rig that it carries
    entry_bits: int | None = None  # 16 or 8, of a table's entry in its file; None: it is from none

    def __post_init__(self):
        assert self.neighbours.shape == (self.mesh.tet_count, 4), self.neighbours.shape
        assert self.occupancy.shape == (self.mesh.tet_count,), self.occupancy.shape
        assert self.table.shape == (self.layout.offsets[-1], FEATURES), self.table.shape

    @property
    def attribution(self) -> str:
        """Who made what the model is made from, one line for whoever passes it on; may be empty."""
        return printable(self.meta.get("attribution") or "")

    @cached_property
    def definition(self) -> DefinedField:
        """The same for core/definition, in float64."""
        return DefinedField(
            rest_vertices=self.mesh.rest_vertices,
            tets=self.mesh.tets,
            masks=self.occupancy,
            encoding=encoding_of(self.mesh, self.layout, self.table.astype(np.float64)),
            density_layers=_double(self.density_layers),
            color_layers=_double(self.color_layers),
            piece_length=self.options.march_step,
            color_per_ray=self.options.deferred,
        )


def same_values(one, other) -> bool:
    """Whether two fields, or two values of them, are equal to the bit."""
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other)
    if type(one) is not type(other):
        return False
    if is_dataclass(one):
        names = (each.name for each in fields(one))
        return all(same_values(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same_values(one[k], other[k]) for k in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same_values, one, other))
    return one == other


def _double(layers: Layers) -> Layers:
    return tuple((w.astype(np.float64), b.astype(np.float64)) for w, b in layers)


def layer_widths(options: FieldOptions):
    """Input, hidden and output widths of the density and the color network."""
    density = (options.level_count * FEATURES, *options.density_hidden, GEOMETRY_FEATURES)
    color = (GEOMETRY_FEATURES + BASIS_COUNT, *options.color_hidden, 3)
    return density, color


def random_field(
    mesh: TetMesh,
    neighbours: np.ndarray,
    options: FieldOptions,
    seed: int = 0,
    contrast: float = 3.0,
) -> TetField:
    """A field with random features and weights, every sub-tet occupied.

    Training starts from one with contrast 1e-4; with a larger contrast it makes a demanding
    test image.
    """
    rng = np.random.default_rng(seed)
    layout = make_layout(mesh, options.level_count, options.table_size, options.dense_levels)

    def layer(fan_in, fan_out):
        bound = np.sqrt(6.0 / fan_in)
        weights = rng.uniform(-bound, bound, (fan_in, fan_out)).astype(np.float32)
        return weights, np.zeros(fan_out, np.float32)

    density, color = (tuple(starmap(layer, pairwise(w))) for w in layer_widths(options))
    table = rng.uniform(-contrast, contrast, (layout.offsets[-1], FEATURES)).astype(np.float32)
    occupancy = np.full(mesh.tet_count, 2**64 - 1, np.uint64)
    return TetField(mesh, neighbours, occupancy, layout, table, density, color, options, np.eye(4))
