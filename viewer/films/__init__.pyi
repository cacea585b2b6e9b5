from .video import CODECS as CODECS, encoder as encoder
from .choices import (
    FORMATS as FORMATS,
    FREE as FREE,
    KINDS as KINDS,
    RATES as RATES,
    SAMPLE_COUNTS as SAMPLE_COUNTS,
    SIZES as SIZES,
    TURN_SECONDS as TURN_SECONDS,
    FilmChoices as FilmChoices,
)
from .recorder import (
    Recorder as Recorder,
    stamped as stamped,
    without_background as without_background,
)
from .takes import Takes as Takes

# For deformrf render.
from .camera_path import load_camera_path as load_camera_path
from .estimate import Hurry as Hurry, render_seconds as render_seconds
from .film import Film as Film, clip_session as clip_session, with_timeline as with_timeline
from .film_maker import FilmMaker as FilmMaker, FilmOptions as FilmOptions
