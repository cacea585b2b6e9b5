from .xpbd import XpbdSolver as XpbdSolver
from .xpbd_options import TIME_STEP as TIME_STEP, XpbdOptions as XpbdOptions
from .material import (
    LOWEST_POISSON_RATIO as LOWEST_POISSON_RATIO,
    Material as Material,
    PRESETS as PRESETS,
)
from .colliders import Box as Box, Sphere as Sphere
from .handles import (
    control_vertices as control_vertices,
    falloff as falloff,
    lowest_pins as lowest_pins,
    vertices_within as vertices_within,
)
from .strain import (
    at_vertices as at_vertices,
    deformation_gradients as deformation_gradients,
    rest_tets as rest_tets,
    strains as strains,
    volume_ratios as volume_ratios,
)

# For the viewer.
from .held_stiffness import HELD_SHARE as HELD_SHARE
from .xpbd import kernel_modules as kernel_modules

from .xpbd_options import FIRST_INTEGRATOR as FIRST_INTEGRATOR, INTEGRATORS as INTEGRATORS

# For solvers beside this one, which the lab compares with it.
from .constraints import (
    edge_constraints as edge_constraints,
    lumped_masses as lumped_masses,
    volume_constraints as volume_constraints,
)
from .inversion import EACH_HOLDS as EACH_HOLDS
from .rescue import distortion as distortion
