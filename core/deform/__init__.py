"""Positions over time: XPBD with materials, handles and pins.  Knows nothing of radiance."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "colliders": ["Box", "Sphere"],
        "handles": ["control_vertices", "falloff", "lowest_pins", "vertices_within"],
        "kernels": ["kernel_modules"],
        "material": ["LOWEST_POISSON_RATIO", "Material", "PRESETS"],
        "xpbd": ["XpbdSolver"],
        "xpbd_options": ["TIME_STEP", "XpbdOptions"],
        # For solvers beside this one, which the lab compares with it.
        "arrays": ["upload"],
        "constraints": [
            "COMPLIANCE_FLOOR",
            "SECOND_SOFTENING",
            "SOFTENED_BELOW",
            "STEP_LIMIT",
            "SWEEP_SOFTENING",
            "edge_constraints",
            "lumped_masses",
            "volume_constraints",
            "volume_gradients",
        ],
        "inversion": ["EACH_HOLDS"],
        "rescue": ["distortion"],
        # For pictures.
        "strain": [
            "at_vertices",
            "deformation_gradients",
            "rest_tets",
            "strains",
            "volume_ratios",
        ],
    },
)
