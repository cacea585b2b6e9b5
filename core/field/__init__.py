"""The radiance field: features at nested tetrahedra, two networks, and the model file."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "modelfile": ["load", "save"],
        "archive": ["ModelFileError", "parts_of_file"],
        "packing": ["STIFFNESS_RANGE"],
        "bounds": ["check_finite", "check_geometry"],
        "field": ["FieldOptions", "TetField", "random_field"],
        "reduction": ["cut", "nearer_to_matter", "reduced", "specks", "without_specks"],
        "levels": ["below_pixel", "level_edges", "narrowest_pixel"],
        # For the rooms next door: kernels, their functions and array structs.
        "encoding": [
            "ENCODING_H",
            "Tables",
            "encode_backward_kernel",
            "encode_kernel",
            "encoded_half",
            "make_tables",
        ],
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
        "layout": ["FEATURES", "node_table"],
        "networks": [
            "BASIS_COUNT",
            "CONSTANT_BASIS",
            "GEOMETRY_FEATURES",
            "LAYERS_H",
            "NATIVE_VALUES",
            "NETWORK_BLOCK",
            "NativeNetworks",
            "TorchNetworks",
            "basis_of",
            "basis_vector",
            "evaluate_kernel",
            "evaluators",
            "native_networks",
            "networks_kernel",
        ],
        "occupancy": [
            "SUBTET_COUNT",
            "is_occupied",
            "is_occupied_reference",
            "occupied_share",
            "pack_mask",
            "subtet_ahead",
            "subtet_corners",
            "subtet_middles",
            "subtet_of",
            "unpack_mask",
        ],
    },
)
