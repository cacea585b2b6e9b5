"""A film of a clip: a session that plays it, as a hand in the viewer would."""

import math

from ...core.deform import TIME_STEP
from ..document import KEY, TICKS_PER_SECOND, Event, Session, SessionError, start_of

SETTLED = 1  # times that a soft clip is played before the film begins, so that it repeats


def clip_session(scene, name: str, softness: float, seconds: float | None):
    """A session in which a clip plays, again and again, from its beginning.

    Args:
        scene: At rest.
        seconds: How long the film is; None: as long as the clip.

    Returns:
        The session, the tick at which the film begins, and how long it is [s].

    Raises:
        SessionError: The model has no such clip.
    """
    names = [clip.name for clip in scene.rigging.clips]
    if name not in names:
        others = f"its clips are {', '.join(names)}" if names else "it has none"
        raise SessionError(f"the model has no clip {name!r}: {others}")
    duration = scene.rigging.clip(name).duration
    seconds = max(duration, TIME_STEP) if seconds is None else seconds
    begin = round(SETTLED * duration * TICKS_PER_SECOND) if softness > 0.0 else 0
    ticks = begin + math.ceil(seconds * TICKS_PER_SECOND)
    events = [
        Event(0, "set_softness", {"softness": softness}),
        Event(0, "play_clip", {"clip": name}),
    ]
    return Session({KEY: 1, "start": start_of(scene), "ticks": ticks}, events), begin, seconds
