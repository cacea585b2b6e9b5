"""What is learned: features at nested tetrahedra, two networks, and the model file."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "archive": ["ModelFileError", "parts_of_file", "read_arrays"],
        "encoding": [
            "FEATURES",
            "Tables",
            "dense_nodes",
            "encode_backward_kernel",
            "encode_kernel",
            "hashed_entries",
            "make_tables",
            "node_table",
        ],
        "field": ["FieldOptions", "TetField", "random_field"],
        "grid": [
            "GRID_ENTRIES",
            "GRID_LEVELS",
            "RESOLUTIONS",
            "Surroundings",
            "contracted",
            "grid_encode_backward_kernel",
            "grid_encode_kernel",
            "surroundings_widths",
        ],
        "levels": ["below_pixel", "level_edges", "narrowest_pixel"],
        "modelfile": ["load", "save"],
        "networks": [
            "BASIS_COUNT",
            "CONSTANT_BASIS",
            "GEOMETRY_FEATURES",
            "TorchNetworks",
            "basis_of",
            "basis_vector",
            "evaluator",
            "networks_kernel",
        ],
        "occupancy": [
            "LEVELS",
            "SUBTET_COUNT",
            "fill_enclosed",
            "is_occupied",
            "is_occupied_reference",
            "occupied_share",
            "subtet_ahead",
            "subtet_of",
        ],
        "packing": ["pack_tables"],
        "reach": ["reached_entries"],
        "wide": [
            "load_wide",
            "load_wide_half",
            "load_wide_int",
            "store_wide",
            "store_wide_half",
            "vec4h",
        ],
    },
)
