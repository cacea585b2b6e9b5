from .mesh import (
    EDGES as EDGES,
    TetMesh as TetMesh,
    boundary_faces as boundary_faces,
    components as components,
    edges as edges,
    extract as extract,
    face_components as face_components,
    fill_enclosed as fill_enclosed,
    signed_volumes as signed_volumes,
    tet_neighbours as tet_neighbours,
)
from .embedded import EmbeddedSurface as EmbeddedSurface, located as located
from .lattice import (
    A15 as A15,
    BCC as BCC,
    KUHN as KUHN,
    Lattice as Lattice,
    a15_grid as a15_grid,
    cell_tets as cell_tets,
    lattice_spacing as lattice_spacing,
    lattice_vertices as lattice_vertices,
)

# For the rooms next door.
from .embedded import EmbeddedPoints as EmbeddedPoints
from .planes import Plane as Plane, heaviest_plane as heaviest_plane
from .lattice import morton_order as morton_order
from .coloring import color_order as color_order, lattice_addresses as lattice_addresses

# For the field: subdivision in NumPy, and the functions of its kernels.
from .subdivision import (
    along as along,
    child_of as child_of,
    into_child as into_child,
    lattice_axes as lattice_axes,
    lattice_cell as lattice_cell,
    lattice_point as lattice_point,
    lattice_weights as lattice_weights,
    path_corners as path_corners,
    path_nodes as path_nodes,
)
