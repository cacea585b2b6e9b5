"""Which values the arguments of a session's edits can have.

ARGUMENTS has a test for each name of an argument.  Those whose range depends on the model or on
the edit are in `is_good`.
"""

import math
from dataclasses import fields

from ...core.base.arguments import LARGEST_SIZE, SMALLEST_SIZE
from ...core.deform import Material
from ...core.render import MODES
from ...wings.rig import METHODS, MOST_BONES
from ..camera import CLOSEST, FARTHEST, Orbit
from ..history import EDITS
from ..rigging import ENDS, LOOSE, SPEEDS
from ..scene import LONGEST_NAME, MOST_ADDED, MOST_POINTS
from ..settings import MESH_RANGES, SHOWN, SURFACES
from ..timeline import EASINGS, MOTIONS, TRACKS, WEIGHTS
from ..timeline import LONGEST as LONGEST_KEY

MASK_DIGITS, HEXADECIMAL = 16, set("0123456789abcdef")
MOST_TETS = 2**31
FARTHEST_POINT = 1e3  # model units
MATERIAL = tuple(f.name for f in fields(Material))
OPTIONS = "substep_count", "contact"
LONGEST_CLIP = 86400.0  # s
LONGEST_CLIP_NAME = 100


def is_number(value, low, high, kind=(int, float)) -> bool:
    """Whether a value from a file is a number between bounds; true and false are none."""
    return isinstance(value, kind) and not isinstance(value, bool) and low <= value <= high


def _is_point(value):
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(is_number(x, -FARTHEST_POINT, FARTHEST_POINT) for x in value)
    )


def _is_direction(value):
    return _is_point(value) and abs(math.hypot(*value) - 1.0) < 1e-6


def _is_name(value):
    return isinstance(value, str) and value.isprintable() and 0 < len(value) <= LONGEST_NAME


def _is_orbit(value):
    """All values of a camera."""
    return (
        isinstance(value, dict)
        and set(value) == set(ORBIT)
        and all(ARGUMENTS[key](one) for key, one in value.items())
    )


def _are_vertices(value, count):
    return isinstance(value, list) and all(is_number(x, 0, count - 1, int) for x in value)


def _are_weights(value):
    """Of a point in a tet."""
    good = isinstance(value, list) and len(value) == 4
    return good and all(is_number(x, 0.0, 1.0) for x in value) and abs(sum(value) - 1.0) < 1e-6


def _are_points(value, count):
    """Rows of four vertices and four weights."""
    return (
        isinstance(value, list)
        and len(value) <= MOST_POINTS + MOST_ADDED
        and all(
            isinstance(row, list) and _are_vertices(row[:4], count) and _are_weights(row[4:])
            for row in value
        )
    )


def _are_masks(value):
    """Of sub-tets, in hexadecimal."""
    return isinstance(value, list) and all(map(_is_mask, value))


def _is_mask(value):
    return isinstance(value, str) and len(value) == MASK_DIGITS and set(value) <= HEXADECIMAL


def _is_color(value):
    return isinstance(value, list) and len(value) == 3 and all(is_number(x, 0, 1) for x in value)


def _is_clip(value):
    good = isinstance(value, str) and value.isprintable()
    return good and 0 < len(value) <= LONGEST_CLIP_NAME


def _are_bones(value):
    return isinstance(value, list) and all(is_number(x, 0, MOST_BONES - 1, int) for x in value)


def _are_rotations(value):
    """Unit quaternions."""
    return isinstance(value, list) and all(
        isinstance(one, list)
        and len(one) == 4
        and all(is_number(x, -1.0, 1.0) for x in one)
        and abs(math.hypot(*one) - 1.0) < 1e-6
        for one in value
    )


def _number(low, high, kind=(int, float)):
    return lambda value: is_number(value, low, high, kind)


def _flag(value):
    return isinstance(value, bool)


ARGUMENTS = {  # name: whether a value is one; but for vertices, whose number depends on the mesh
    "radius": _number(0.0, 10.0),
    "to": _is_point,
    "rotation": _is_point,
    "scale": _number(1e-3, 1e3),
    "weights": _are_weights,
    "text": lambda value: value == "" or _is_name(value),
    "point": _is_point,
    "tets": lambda value: _are_vertices(value, MOST_TETS),  # the edit knows how many there are
    "masks": _are_masks,
    "towards_eye": _is_point,
    "factor": _number(0.1, 10.0),
    "strength": _number(0.0, 1e4),
    "rate": _number(0.0, 1e4),
    "speed": _number(-1e4, 1e4),
    "meters_per_unit": _number(1e-3 * SMALLEST_SIZE, 1e3 * LARGEST_SIZE),
    "floor": _number(-FARTHEST_POINT, FARTHEST_POINT),
    "height": lambda value: value is None or _number(-FARTHEST_POINT, FARTHEST_POINT)(value),
    **dict.fromkeys(("soft", "pinned", "held", "on", "contact", "pose"), _flag),
    "substep_count": _number(1, 1000, int),
    # of a material
    "young_modulus": _number(1.0, 1e12),
    "poisson_ratio": _number(0.0, 0.4999),
    "density": _number(1e-3, 1e6),
    "damping": _number(0.0, 1e4),
    "yield_strain": lambda value: value is None or _number(1e-6, 1e6)(value),
    # of a view
    "target": _is_point,
    "distance": _number(CLOSEST, FARTHEST),
    "yaw": _number(-10.0, 10.0),
    "pitch": _number(-0.5 * math.pi, 0.5 * math.pi),
    "roll": _number(-10.0, 10.0),
    "up": _is_direction,
    "parallel": _flag,
    "field_of_view": _number(1e-3, 3.0),
    **dict.fromkeys(("stiffness", "rig"), lambda value: value is None or isinstance(value, str)),
    "mode": lambda value: value in MODES,
    "background": _is_color,
    **dict.fromkeys(("checkerboard", "show_handles", "show_wireframe", "show_ground"), _flag),
    "name": _is_name,
    "view": _is_orbit,
    "mesh_surface": lambda value: value in SURFACES,
    "mesh_opacity": _number(0.0, 1.0),
    "mesh_range": _number(*MESH_RANGES),
    # of the timeline
    **dict.fromkeys(("tick", "to_tick"), _number(0, LONGEST_KEY, int)),
    "ticks": _number(1, LONGEST_KEY, int),
    "orbit": lambda value: value is None or _is_orbit(value),
    "track": lambda value: value in TRACKS,
    "easing": lambda value: isinstance(value, str) and value in EASINGS,
    "motion": lambda value: value in MOTIONS,
    "weight": _number(*WEIGHTS),
    # of bones
    **dict.fromkeys(("head", "tail"), _is_point),
    "parent": _number(-1, MOST_BONES - 1, int),
    "bone": _number(LOOSE, MOST_BONES - 1, int),
    "bones": _are_bones,
    "end": lambda value: value in ENDS,
    "rotations": _are_rotations,
    "clip": _is_clip,
    "seconds": _number(0.0, LONGEST_CLIP),
    "softness": _number(0.0, 1.0),
    "method": lambda value: value in METHODS,
    "show_bones": _flag,
}
START = "meters_per_unit", "pins", "points", "floor", "stiffness", "rig"  # besides the material
ORBIT = tuple(f.name for f in fields(Orbit))
ANY_NAMES = {"set_material": MATERIAL, "set_options": tuple(OPTIONS)}
VIEW = (*ORBIT, *SHOWN)


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


def is_good(name, key, value, vertex_count):
    """Whether an edit's argument can have a value."""
    handles = vertex_count + MOST_POINTS + MOST_ADDED
    if key == "vertex":
        return is_number(value, 0, (vertex_count if name == "paint" else handles) - 1, int)
    if key in ("others", "ids"):
        return _are_vertices(value, handles)
    if key in ("pins", "corners"):
        return _are_vertices(value, vertex_count) and (key == "pins" or len(value) == 4)
    if key == "points":
        return _are_points(value, vertex_count)
    if (name, key) == ("set_clip_speed", "speed"):
        return is_number(value, *SPEEDS)
    if (name, key) == ("push", "radius"):
        return is_number(value, 1e-6, 10.0)
    return ARGUMENTS[key](value)
