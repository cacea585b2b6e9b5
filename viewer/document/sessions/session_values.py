"""Which values the arguments of a session's edits can have.

ARGUMENTS has a check for each name of an argument; `arguments_for` adds those whose range depends
on the mesh or on the edit.
"""

import math
import re
from dataclasses import fields
from functools import cache

import numpy as np

from ....core.base.arguments import LARGEST_SIZE, SMALLEST_SIZE
from ....core.base.schema import (
    Check,
    both,
    flag,
    integer,
    listing,
    mapping,
    number,
    one_of,
    optional,
    row,
    text,
    vector,
)
from ....core.deform import INTEGRATORS, Material
from ....wings.rig import METHODS, MOST_BONES
from ...camera import CLOSEST, FARTHEST, Orbit
from ...settings import HANDS, SHOWN, kept_in
from ..history.journal import EDITS
from ..rigging.joints import ENDS, LOOSE
from ..rigging.posing import SPEEDS
from ..scene.clock import MAX_STEPS
from ..scene.handles import MOST_ADDED
from ..scene.points import MOST_POINTS
from ..scene.viewpoint import LONGEST_NAME
from ..timeline.keys import EASINGS
from ..timeline.keys import LONGEST as LONGEST_KEY
from ..timeline.timeline import MOTIONS, TRACKS, WEIGHTS

MOST_TETS = 2**31
FARTHEST_POINT = 1e3  # model units
MATERIAL = tuple(f.name for f in fields(Material))
ORBIT = tuple(f.name for f in fields(Orbit))
OPTIONS = "substep_count", "contact"
# What a start has besides the material and OPTIONS.
START = "automatic_substeps integrator meters_per_unit pins points floor hand stiffness rig".split()
ANY_NAMES = {"set_material": MATERIAL, "set_options": OPTIONS}
VIEW = (*ORBIT, *SHOWN)
LONGEST_CLIP = 86400.0  # s
LONGEST_CLIP_NAME = 100
MASK = re.compile("[0-9a-f]{16}")  # of a tet's sub-tets


def _is_unit(values) -> bool:
    return abs(math.hypot(*values) - 1.0) < 1e-6


def _is_stretch(rows) -> bool:
    matrix = np.array(rows, float)
    return abs(matrix - matrix.T).max() < 1e-6 and np.linalg.eigvalsh(matrix)[0] >= 1e-3


def _is_partition(weights) -> bool:
    return abs(sum(weights) - 1.0) < 1e-6


coordinate = number(-FARTHEST_POINT, FARTHEST_POINT)
point = vector(3, coordinate)
share = number(0.0, 1.0)
camera = {
    "target": point,
    "distance": number(CLOSEST, FARTHEST),
    "yaw": number(-10.0, 10.0),
    "pitch": number(-0.5 * math.pi, 0.5 * math.pi),
    "roll": number(-10.0, 10.0),
    "up": both(point, _is_unit),
    "parallel": flag,
    "field_of_view": number(1e-3, 3.0),
}
ARGUMENTS = {
    "radius": number(0.0, 10.0),
    **dict.fromkeys(("to", "rotation", "point", "towards_eye", "head", "tail"), point),
    "scale": number(1e-3, 1e3),
    "stretch": both(vector(3, vector(3, number(-1e3, 1e3))), _is_stretch),
    "weights": both(vector(4, share), _is_partition),
    "text": both(text(LONGEST_NAME), str.isprintable),
    "tets": listing(integer(0, MOST_TETS - 1)),  # the edit knows how many there are
    "masks": listing(both(text(), MASK.fullmatch)),
    "factor": number(0.1, 10.0),
    "strength": number(0.0, 1e4),
    "rate": number(0.0, 1e4),
    "speed": number(-1e4, 1e4),
    "meters_per_unit": number(1e-3 * SMALLEST_SIZE, 1e3 * LARGEST_SIZE),
    "floor": coordinate,
    "height": optional(coordinate),
    **dict.fromkeys(("soft", "pinned", "held", "on", "contact", "pose"), flag),
    "substep_count": integer(1, 1000),
    "count": integer(1, MAX_STEPS),
    "hand": one_of(HANDS),
    "automatic_substeps": flag,
    "integrator": one_of(INTEGRATORS),
    # of a material
    "young_modulus": number(1.0, 1e12),
    "poisson_ratio": number(0.0, 0.4999),
    "density": number(1e-3, 1e6),
    "damping": number(0.0, 1e4),
    "yield_strain": optional(number(1e-6, 1e6)),
    # of a view
    **camera,
    **dict.fromkeys(("stiffness", "rig"), optional(text())),
    **kept_in("session"),
    "name": both(text(LONGEST_NAME, least=1), str.isprintable),
    "view": mapping(camera),
    # of the timeline
    **dict.fromkeys(("tick", "to_tick"), integer(0, LONGEST_KEY)),
    "ticks": integer(1, LONGEST_KEY),
    "orbit": optional(mapping(camera)),
    "track": one_of(TRACKS),
    "easing": one_of(EASINGS),
    "motion": one_of(MOTIONS),
    "weight": number(*WEIGHTS),
    # of bones
    "parent": integer(-1, MOST_BONES - 1),
    "bone": integer(LOOSE, MOST_BONES - 1),
    "bones": listing(integer(0, MOST_BONES - 1)),
    "end": one_of(ENDS),
    "rotations": listing(both(vector(4, number(-1.0, 1.0)), _is_unit)),
    "translations": listing(point),
    "clip": both(text(LONGEST_CLIP_NAME, least=1), str.isprintable),
    "seconds": number(0.0, LONGEST_CLIP),
    "softness": share,
    "method": one_of(METHODS),
}


@cache
def arguments_for(vertex_count: int) -> dict[str | tuple[str, str], Check]:
    """The check of each argument for a mesh, and of (edit, argument) where an edit has its own."""
    vertex = integer(0, vertex_count - 1)
    handle = integer(0, vertex_count + MOST_POINTS + MOST_ADDED - 1)
    surface_point = row(*[vertex] * 4, *[share] * 4)  # in a tet: its vertices, their weights
    return ARGUMENTS | {
        "vertex": handle,
        **dict.fromkeys(("others", "ids"), listing(handle)),
        "pins": listing(vertex),
        "corners": vector(4, vertex),
        "points": listing(
            both(surface_point, lambda values: _is_partition(values[4:])), MOST_POINTS + MOST_ADDED
        ),
        ("paint", "vertex"): vertex,
        ("set_clip_speed", "speed"): number(*SPEEDS),
        ("push", "radius"): number(1e-6, 10.0),
    }


def bad_arguments(name: str, arguments: dict, vertex_count: int) -> list[str]:
    """Which arguments an edit, a view or a session's start can't have, or not with their values."""
    if name == "start":
        known = (*MATERIAL, *OPTIONS, *START)
    elif name == "view":
        known = VIEW
    else:
        known = ANY_NAMES.get(name, EDITS[name].parameters)
    return [
        key
        for key, value in arguments.items()
        if not (key in known and is_good(name, key, value, vertex_count))
    ]


def is_good(name: str, key: str, value, vertex_count: int) -> bool:
    """Whether an edit's argument can have a value."""
    checks = arguments_for(vertex_count)
    good = checks.get((name, key)) or checks[key]
    return bool(good(value))
