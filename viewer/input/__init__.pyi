from .controls import Controls as Controls
from .fly import Fly as Fly
from .actions import ACTIONS as ACTIONS
from .inputs import (
    INPUTS as INPUTS,
    action_of as action_of,
    inputs_of as inputs_of,
    label_of as label_of,
)
from .gizmo import Part as Part, gizmo_of as gizmo_of
from .view_actions import (
    AXIS_VIEWS as AXIS_VIEWS,
    FROM_VIEW as FROM_VIEW,
    UPS as UPS,
    set_up as set_up,
    up_name as up_name,
)
from .delete_actions import found_box as found_box
from .deleting import BRUSH as BRUSH
from .rig_actions import bone_line as bone_line, name_bone as name_bone, rest_bone as rest_bone
from .timeline_actions import delete_key as delete_key
from .photo_actions import (
    line_of as line_of,
    placed_photograph as placed_photograph,
    show_photograph as show_photograph,
)
