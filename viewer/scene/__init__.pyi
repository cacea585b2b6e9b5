from .scene import MAX_STEPS as MAX_STEPS, Scene as Scene
from .body import EARTH as EARTH
from .cuts import masks_of as masks_of
from .handles import MOST_ADDED as MOST_ADDED
from .points import ControlPoints as ControlPoints, MOST_POINTS as MOST_POINTS
from .grabs import (
    Motion as Motion,
    rotation_matrix as rotation_matrix,
    rotation_vector as rotation_vector,
    stretched as stretched,
)
from .surface import visible_points as visible_points
from .viewpoint import LONGEST_NAME as LONGEST_NAME, clean_name as clean_name
