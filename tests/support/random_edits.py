"""Random sessions: every edit of the table, with any values that the reader allows.

Some values are likely ones, so that edits follow from each other; some are at the ends of what
is allowed.  `random_events` draws the lines of a session behind its first.
"""

import math

import numpy as np

from deformrf.core.base.arguments import LARGEST_SIZE, SMALLEST_SIZE
from deformrf.core.deform import Material
from deformrf.core.render import MODES
from deformrf.viewer.camera import CLOSEST, FARTHEST
from deformrf.viewer.document import EASINGS, EDITS, MAX_STEPS, MOTIONS, TRACKS, WEIGHTS
from deformrf.viewer.document.sessions.session_values import ANY_NAMES, ARGUMENTS, is_good
from deformrf.viewer.settings import HANDS, SURFACES
from deformrf.wings.rig import METHODS, MOST_BONES

NAMES = "a", "b", "Run"
OFTEN = (
    "grab",
    "grab_pins",
    "move",
    "stretch",
    "key",
    "play",
    "add_bone",
    "hold_bone",
    "turn_bones",
    "move_bones",
    "set_softness",
)


class Draw:
    """Draws values for the edits of a model of V vertices and T tets."""

    def __init__(self, rng, vertices: int, tets: int):
        self.rng, self.vertices, self.tets = rng, vertices, tets

    def number(self, low, high):
        kind = self.rng.integers(5)
        if kind == 0:
            return float(self.rng.choice([low, high]))
        if kind == 1 and low > 0.0:
            return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))
        middle = min(max(0.5, low), high)
        near = (low, high) if kind == 2 else (max(low, middle - 0.5), min(high, middle + 1.0))
        return float(self.rng.uniform(*near))

    def whole(self, low, high, likely=4):
        ends = [low, high, int(self.rng.integers(low, high + 1))]
        return int(
            self.rng.choice([*ends, *self.rng.integers(low, min(high, low + likely) + 1, 5)])
        )

    def point(self):
        if self.rng.random() < 0.1:
            return self.rng.choice([-1e3, 0.0, 1e3], 3).tolist()
        return self.rng.uniform(-0.2, 1.2, 3).tolist()

    def direction(self):
        way = self.rng.normal(size=3)
        return (way / np.linalg.norm(way)).tolist()

    def several(self, one, most=4):
        return [one() for _ in range(self.rng.integers(most))]

    def weights(self):
        shares = self.rng.dirichlet(np.ones(4))
        shares[0] = 1.0 - shares[1:].sum()
        return np.clip(shares, 0.0, 1.0).tolist()

    def rotation(self):
        turn = self.rng.normal(size=4)
        return (turn / np.linalg.norm(turn)).tolist()

    def stretch(self):
        turn, _ = np.linalg.qr(self.rng.normal(size=(3, 3)))
        made = turn @ np.diag([self.number(2e-3, 1e2) for _ in range(3)]) @ turn.T
        return (0.5 * (made + made.T)).tolist()

    def flag(self):
        return bool(self.rng.integers(2))

    def one_of(self, values):
        values = list(values)
        return values[self.rng.integers(len(values))]

    def orbit(self):
        return {
            "target": self.point(),
            "distance": self.number(CLOSEST, FARTHEST),
            "yaw": self.number(-10.0, 10.0),
            "pitch": self.number(-0.5 * math.pi, 0.5 * math.pi),
            "roll": self.number(-10.0, 10.0),
            "up": self.one_of([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], self.direction()]),
            "parallel": self.flag(),
            "field_of_view": self.number(1e-3, 3.0),
        }

    def value(self, edit, key):
        """A value for an argument of an edit."""
        bone = self.whole(-1, MOST_BONES - 1, 3)
        numbers = {
            "radius": (1e-6, 10.0),
            "scale": (1e-3, 1e3),
            "factor": (0.1, 10.0),
            "strength": (0.0, 1e4),
            "rate": (0.0, 1e4),
            "speed": (-4.0, 4.0) if edit == "set_clip_speed" else (-1e4, 1e4),
            "meters_per_unit": (1e-3 * SMALLEST_SIZE, 1e3 * LARGEST_SIZE),
            "weight": WEIGHTS,
            "seconds": (0.0, 86400.0),
            "softness": (0.0, 1.0),
            "young_modulus": (1.0, 1e12),
            "poisson_ratio": (0.0, 0.4999),
            "density": (1e-3, 1e6),
            "damping": (0.0, 1e4),
            "yield_strain": (1e-6, 1e6),
            "height": (-1e3, 1e3),
        }
        if key in numbers:
            nothing = key in ("height", "yield_strain") and self.flag()
            return None if nothing else self.number(*numbers[key])
        if key == "vertex":
            return self.whole(0, self.vertices - 1 if edit == "paint" else self.vertices + 200)
        if key in ("others", "ids"):
            return self.several(lambda: self.whole(0, self.vertices + 200, self.vertices))
        if key == "masks":
            return self.several(lambda: f"{self.rng.integers(2**63):016x}")
        if key == "tets":
            return self.several(lambda: self.whole(0, self.tets, self.tets))
        if key in ("soft", "pinned", "held", "on", "contact", "pose"):
            return self.flag()
        drawn = {
            **dict.fromkeys(("to", "rotation", "point", "towards_eye", "head", "tail"), self.point),
            "corners": lambda: self.rng.integers(0, self.vertices, 4).tolist(),
            **{"weights": self.weights, "stretch": self.stretch},
            "text": lambda: self.one_of(["", *NAMES]),
            "name": lambda: self.one_of(NAMES),
            "clip": lambda: self.one_of(NAMES),
            "view": self.orbit,
            "orbit": lambda: None if self.rng.random() < 0.2 else self.orbit(),
            "tick": lambda: self.whole(0, 36000, 5),
            "to_tick": lambda: self.whole(0, 36000, 5),
            "ticks": lambda: self.whole(1, 36000, 40),
            "track": lambda: self.one_of(TRACKS),
            "easing": lambda: self.one_of(EASINGS),
            "motion": lambda: self.one_of(MOTIONS),
            "method": lambda: self.one_of(METHODS),
            "end": lambda: self.one_of(["head", "tail"]),
            "bone": lambda: bone,
            "parent": lambda: bone,
            "bones": lambda: self.several(lambda: self.whole(0, MOST_BONES - 1, 3)),
            "rotations": lambda: self.several(self.rotation),
            "translations": lambda: self.several(self.point),
            "substep_count": lambda: self.whole(1, 40),
            "count": lambda: self.whole(1, MAX_STEPS),
            "hand": lambda: self.one_of(HANDS),
        }
        return drawn[key]()

    def event(self, name):
        """The arguments of an edit, or of a view."""
        if name == "view":
            shown = {"mode": self.one_of(MODES), "mesh_surface": self.one_of(SURFACES)}
            return self.one_of([self.orbit(), shown, {}])
        if name in ANY_NAMES:
            names = [f for f in ANY_NAMES[name] if self.flag()]
            return {key: self.value(name, key) for key in names}
        values = {key: self.value(name, key) for key in EDITS[name].parameters}
        likely = self.rng.random() < 0.8  # so that lists fit together
        if "masks" in values and likely:
            values["masks"] = [f"{self.rng.integers(2**63):016x}" for _ in values["tets"]]
        if "rotations" in values and likely:
            values["rotations"] = [self.rotation() for _ in values["bones"]]
        if "translations" in values and likely:
            values["translations"] = [self.point() for _ in values["bones"]]
        return values


def random_events(rng, vertices: int, tets: int, count: int, ticks: int) -> list[list]:
    """Lines [tick, name, arguments], of which the reader allows every one."""
    draw, names = Draw(rng, vertices, tets), [*EDITS, "view"]
    assert set(ARGUMENTS) and set(Material.__dataclass_fields__) <= set(ARGUMENTS)
    found = []
    for tick in np.sort(rng.integers(0, ticks + 1, count)).tolist():
        name = draw.one_of(OFTEN) if rng.random() < 0.3 else draw.one_of(names)
        arguments = draw.event(name)
        bad = [k for k, v in arguments.items() if not is_good(name, k, v, vertices)]
        assert not bad, (name, bad, arguments)
        found.append([tick, name, arguments])
    return found
