from .timeline import MOTIONS as MOTIONS, TRACKS as TRACKS, Timeline as Timeline, WEIGHTS as WEIGHTS
from .keys import (
    CameraKey as CameraKey,
    EASINGS as EASINGS,
    LONGEST as LONGEST,
    orbit_at as orbit_at,
)
from .strip import (
    TimeScale as TimeScale,
    Strip as Strip,
    TICKS_PER_SECOND as TICKS_PER_SECOND,
    as_time as as_time,
    shown_ticks as shown_ticks,
)
