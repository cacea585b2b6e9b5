from .controls import Controls as Controls
from .fly import Fly as Fly
from .keys import (
    ALT as ALT,
    CTRL as CTRL,
    LEFT as LEFT,
    MIDDLE as MIDDLE,
    OTHER_NAMES as OTHER_NAMES,
    RIGHT as RIGHT,
    SHIFT as SHIFT,
)
from .drags import KINDS as KINDS, MOVE as MOVE, SCALE as SCALE, TURN as TURN
from .gizmo import Part as Part
from .brushes import BRUSH as BRUSH, found_box as found_box, said as said
