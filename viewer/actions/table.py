"""All actions, once their modules are imported: in the order of the menus and of the help."""

from . import filing  # noqa: F401, I001
from . import editing, viewing, photographs, bones, animating, filming, helping  # noqa: F401
from .action import ACTIONS as ACTIONS
from .action import INPUTS as INPUTS
from .action import SECTIONS as SECTIONS
from .action import Action as Action
from .action import Input as Input
from .action import action_of as action_of
from .action import input_of as input_of
from .action import inputs_of as inputs_of
from .action import label_of as label_of
from .action import section_of as section_of
