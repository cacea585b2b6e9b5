from .sessions.session import (
    Session as Session,
    SessionError as SessionError,
    load_session as load_session,
)
from .sessions.player import poses as poses

# For the rest of the viewer, and the commands.
from .scene.scene import Scene as Scene
from .scene.clock import MAX_STEPS as MAX_STEPS
from .scene.body import EARTH as EARTH, Body as Body
from .scene.cuts import masks_of as masks_of
from .scene.handles import MOST_ADDED as MOST_ADDED, Handles as Handles
from .scene.points import ControlPoints as ControlPoints, MOST_POINTS as MOST_POINTS
from .scene.grabs import (
    Ball as Ball,
    Grab as Grab,
    Motion as Motion,
    rotation_matrix as rotation_matrix,
    rotation_vector as rotation_vector,
    stretched as stretched,
)
from .scene.surface import visible_points as visible_points
from .scene.viewpoint import clean_name as clean_name
from .history.journal import EDITS as EDITS, Event as Event, Journal as Journal
from .timeline.timeline import MOTIONS as MOTIONS, TRACKS as TRACKS, WEIGHTS as WEIGHTS
from .timeline.keys import (
    CameraKey as CameraKey,
    EASINGS as EASINGS,
    LONGEST as LONGEST,
    orbit_at as orbit_at,
)
from .timeline.strip import (
    TimeScale as TimeScale,
    Strip as Strip,
    TICKS_PER_SECOND as TICKS_PER_SECOND,
    as_time as as_time,
    shown_ticks as shown_ticks,
)
from .rigging.rigging import MOST_JOINTS as MOST_JOINTS
from .rigging.posing import SPEEDS as SPEEDS
from .rigging.joints import (
    ENDS as ENDS,
    HEAD as HEAD,
    LOOSE as LOOSE,
    TAIL as TAIL,
    Joint as Joint,
    joint_mask as joint_mask,
)
from .rigging.matter import Matter as Matter
from .rigging.hold import Hold as Hold
from .sessions.session import KEY as KEY, save_session as save_session, start_of as start_of
from .sessions.belonging import open_session as open_session
from .sessions.project import (
    Project as Project,
    ProjectError as ProjectError,
    load_project as load_project,
    save_project as save_project,
)
from .sessions.player import (
    Patience as Patience,
    Player as Player,
    play_patiently as play_patiently,
    spoken as spoken,
)
from .sessions.session_values import FARTHEST_POINT as FARTHEST_POINT
from .sessions.autosave import (
    Autosave as Autosave,
    autosave_folder as autosave_folder,
    left_behind as left_behind,
)
