"""The two networks: their definition, and one module for each place where they run."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "cpu": [
            "LAYERS_H",
            "NATIVE_VALUES",
            "NETWORK_BLOCK",
            "NativeNetworks",
            "multiplies_pairs",
            "native_networks",
        ],
        "density_rows": [
            "OVERWRITTEN_LEVELS",
            "any_of_warp",
            "density_in_room",
            "density_of_rows",
            "density_room",
            "h_in_room",
            "put_features",
            "sigma_in_room",
        ],
        "dispatch": ["evaluators"],
        "mma": ["networks_kernel"],
        "reference": [
            "BASIS_COUNT",
            "CONSTANT_BASIS",
            "GEOMETRY_FEATURES",
            "Layers",
            "basis_of",
            "basis_vector",
            "evaluate",
            "mlp",
            "sigma_from",
            "sigmoid",
            "spherical_harmonics",
        ],
        "torch": ["TorchNetworks"],
    },
)
