from .table import (
    ACTIONS as ACTIONS,
    INPUTS as INPUTS,
    SECTIONS as SECTIONS,
    ActionSearch as ActionSearch,
    BoundActions as BoundActions,
    Input as Input,
    action_of as action_of,
    input_of as input_of,
    inputs_of as inputs_of,
    section_of as section_of,
    told_of as told_of,
)
from .viewing import (
    AXIS_VIEWS as AXIS_VIEWS,
    FROM_VIEW as FROM_VIEW,
    UPS as UPS,
    set_up as set_up,
    up_name as up_name,
)
from .bones import bone_line as bone_line, name_bone as name_bone
from .photographs import (
    line_of as line_of,
    placed_photograph as placed_photograph,
    show_photograph as show_photograph,
)
