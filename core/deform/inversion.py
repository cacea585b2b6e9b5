"""Turn inverted tets back in meshes in which only few tets keep their volume (locking.py).

Edge lengths are the same for a tet and its mirror image.  So while a part has an inverted tet, all
of its tets keep their volume.  Each has a bulk modulus of at most EACH_HOLDS · μ, so that the part
neither locks nor gets stiffer.  This guard ends when, for a while, no tet was inverted or had less
than half its volume.  If the pose then inverts tets again, the guard returns, and lasts longer.
The third time it stays until the user acts, because the body jerks whenever the guard ends.

Shapes: V vertices, P parts (connected components), T tets.
"""

import numpy as np

from .constraints import VolumeConstraints
from .material import Material

EACH_HOLDS = 2.0  # K/μ, that of ν = 0.375
LOOK_EVERY = 4  # frames
WHILES = (0.5, 1.0, np.inf)  # s without an inverted or squeezed tet, until the guard ends


class InversionGuard:
    """Decides in which parts all tets hold their volume.

    Attributes:
        parts: Those whose tets all hold their volume.  [P] bool
    """

    def __init__(self, volumes: VolumeConstraints, part_of):
        """Take the tets, and the part of each vertex.  [V]"""
        self._volumes, self._part_of_tets = volumes, part_of[volumes.vertices[:, 0]]
        count = int(part_of.max()) + 1
        self.parts = np.zeros(count, bool)
        self._of_all = None  # compliances if all tets hold; None if they do so anyway
        self._sound_for = np.zeros(count)  # s
        self._ended = np.zeros(count, int)  # times since the user acted
        self._since = self._frames = 0  # since the last report

    def take(self, material: Material | None, factors=None):
        """Take a material, with factors of Young's modulus at the vertices [V]; None: no guard."""
        self._of_all = None
        if material is None or not self._volumes.sparse or not material.bulk_modulus > 0:
            return
        each = EACH_HOLDS * material.shear_modulus
        of_all = self._volumes.compliances(material.bulk_modulus, each)
        self._of_all = self._volumes.softened(of_all, factors)

    def touch(self):
        """The user did something: inversions from now on are new ones."""
        self._ended[:] = 0

    def reset(self):
        """Vertices were moved by hand: nothing is known of them."""
        self.parts[:] = False
        self._sound_for[:] = self._since = self._frames = 0

    def begin(self, dt) -> bool:
        """Begin a frame of dt [s]; True to look for inverted tets after it."""
        self._since += dt
        self._frames += 1
        return self._frames >= LOOK_EVERY and self._of_all is not None

    def report(self, inverted, squeezed) -> bool:
        """Take the numbers of inverted and of squeezed tets of each part [P].

        Returns:
            Whether `parts` changed.
        """
        self._sound_for += self._since
        self._since = self._frames = 0
        self._sound_for[(inverted > 0) | (squeezed > 0)] = 0.0
        ends = self.parts & (self._sound_for >= np.take(WHILES, self._ended))
        self._ended[ends] += 1
        before, self.parts = self.parts, (self.parts | (inverted > 0)) & ~ends
        return self._of_all is not None and not np.array_equal(before, self.parts)

    @property
    def guards(self):
        """Which tets hold their volume for its sake.  [T] bool"""
        return self.parts[self._part_of_tets] & (self._of_all is not None)

    def guarded(self, compliances):
        """α of all tets to use now, given those of the material [m⁵/N].  [T]"""
        if self._of_all is None or not self.parts.any():
            return compliances
        return np.where(self.guards, self._of_all, compliances)
