from .session import (
    Session as Session,
    SessionError as SessionError,
    load_session as load_session,
)
from .replay import poses as poses

# For the rest of the viewer, and the commands.
from .session import KEY as KEY, save_session as save_session, start_of as start_of
from .belonging import open_session as open_session
from .player import (
    Patience as Patience,
    Player as Player,
    play_patiently as play_patiently,
)
from .session_values import FARTHEST_POINT as FARTHEST_POINT
from .autosave import (
    Autosave as Autosave,
    autosave_folder as autosave_folder,
    left_behind as left_behind,
)
