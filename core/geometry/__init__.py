"""Tetrahedra: lattices, meshes, their subdivision and coloring."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "mesh": [
            "EDGES",
            "TetMesh",
            "boundary_faces",
            "components",
            "edges",
            "extract",
            "face_components",
            "fill_enclosed",
            "signed_volumes",
            "tet_neighbours",
        ],
        "embedded": ["EmbeddedSurface", "located"],
        "lattice": [
            "A15",
            "BCC",
            "KUHN",
            "Lattice",
            "a15_grid",
            "cell_tets",
            "lattice_spacing",
            "lattice_vertices",
            "morton_order",
        ],
        "coloring": ["color_order", "lattice_addresses"],
        # For the field: subdivision in NumPy, and the functions of its kernels.
        "subdivision": [
            "CHILD_VERTICES",
            "along",
            "child_of",
            "child_path",
            "descend",
            "into_child",
            "lattice_axes",
            "lattice_cell",
            "lattice_point",
            "lattice_weights",
            "path_corners",
            "path_nodes",
        ],
    },
)
