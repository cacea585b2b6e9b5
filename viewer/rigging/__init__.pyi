from .rigging import MOST_JOINTS as MOST_JOINTS, Rigging as Rigging, rig_of as rig_of
from .posing import Posing as Posing, SPEEDS as SPEEDS
from .joints import (
    ENDS as ENDS,
    HEAD as HEAD,
    LOOSE as LOOSE,
    TAIL as TAIL,
    Joint as Joint,
    joint_mask as joint_mask,
)
from .matter import Matter as Matter
from .hold import Hold as Hold
