"""What the timeline's strip shows where, and what the mouse has hold of on it.

Along x the strip shows ticks, from 0 at its left end.  Lengths are in points.
"""

from dataclasses import dataclass

from .keys import LONGEST, key_at

TICKS_PER_SECOND = 60
SHORTEST = 5 * TICKS_PER_SECOND  # that is shown
BEYOND = 1.2  # behind the last key, and the playhead, there is space for another one
STEPS = 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 120.0  # s between two numbers
NARROWEST = 46.0  # the way between two numbers
REACH = 8.0  # from the middle of a key, where the mouse has it


@dataclass(frozen=True)
class TimeScale:
    """From ticks to places and back."""

    left: float
    width: float
    ticks: int  # that are shown

    def place(self, tick: float) -> float:
        return self.left + self.width * tick / self.ticks

    def tick(self, place: float) -> int:
        """The nearest one that a key can have."""
        tick = round((place - self.left) / max(self.width, 1.0) * self.ticks)
        return min(max(tick, 0), LONGEST)

    @property
    def step(self) -> float:
        """Seconds between two numbers."""
        per_second = self.width * TICKS_PER_SECOND / self.ticks
        return next((step for step in STEPS if step * per_second >= NARROWEST), STEPS[-1])


def shown_ticks(timeline) -> int:
    """So many that all keys and the playhead are seen."""
    return min(max(SHORTEST, round(BEYOND * max(timeline.end, timeline.head))), LONGEST)


def key_near(keys, scale: TimeScale, place: float) -> int | None:
    """The tick of the key there, or None."""
    near = [key.tick for key in keys if abs(scale.place(key.tick) - place) <= REACH]
    return min(near, key=lambda tick: abs(scale.place(tick) - place), default=None)


def as_time(tick: int) -> str:
    """A tick in seconds."""
    return f"{tick / TICKS_PER_SECOND:.2f} s"


@dataclass
class Strip:
    """The strip of one window."""

    selected: tuple[str, int] | None = None  # a key: its track and tick
    holds: str = ""  # what the mouse drags: "head" or "key"
    to_tick: int = 0  # where a key is dragged to
    scale: TimeScale | None = None  # of the last frame: while something is dragged it stays
    turn_seconds: float = 6.0  # of the next turntable
    pose_name: str = ""  # of the next one that is saved
    clip_name: str = ""  # of the next clip that is made of the keys

    def chosen(self, timeline) -> tuple[str, int] | None:
        """The selected key, if it is still there; else one at the playhead."""
        there = [(track, key.tick) for track, keys in timeline.keys.items() for key in keys]
        if self.selected in there:
            return self.selected
        return next((one for one in there if one[1] == timeline.head), None)

    def press(self, timeline, track: str | None, place: float) -> None:
        """Take the key that is there on a track, or the playhead."""
        tick = None if track is None else key_near(timeline.keys[track], self.scale, place)
        self.selected = None if tick is None else (track, tick)
        self.holds = "head" if tick is None else "key"
        self.to_tick = 0 if tick is None else tick
        if tick is None:
            self.drag(timeline, place)

    def drag(self, timeline, place: float) -> None:
        """Move what is held: the playhead at once, a key when it is let go."""
        tick = self.scale.tick(place)
        if self.holds == "key":
            self.to_tick = tick
        elif tick != timeline.head or timeline.playing:
            timeline.scrub(tick)

    def drop(self, timeline, copy: bool) -> str:
        """Let go: a key stays where it was dragged to, or its copy does.

        Returns:
            What went wrong, as a sentence; else an empty string.
        """
        holds, self.holds = self.holds, ""
        if holds == "key" and self.selected and self.selected[1] != self.to_tick:
            track, tick = self.selected
            if key_at(timeline.keys[track], tick) is None:  # undone meanwhile
                return f"the {track} key that you dragged is gone"
            try:
                (timeline.copy_key if copy else timeline.move_key)(track, tick, self.to_tick)
            except ValueError as error:  # there are too many
                return str(error)
            self.selected = track, self.to_tick
        return ""
