"""How long a film takes, from three of its frames; the window asks a process for it.

A session that leads to them is played in full for some seconds only.  After that its edits are made
without the ticks between them.  Camera, view mode and timeline are therefore those of the film, and
the object is bent about as in it.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ...core.base.device import thread_count
from ..document import Player, spoken
from .film_job import FilmJob
from .film_maker import FilmMaker, Stage

PLAYING = 3.0  # s of playing in full
SETTLING = 300  # ticks that an object goes on moving after an edit, about
FRAMES = 3
MOST_IMAGES = 4  # of a frame; each of the others takes as long
STILL = 0.5  # s that choices stand still before the window asks
WARM_IMAGES = 3  # after which CUDA replays what it has recorded


class Hurry:
    """Sessions that are played in little time, and how long all of it would take."""

    def __init__(self):
        self.spent = self.editing = 0.0  # s, of playing in full, and of edits
        self.played = self.left_out = 0  # ticks

    @property
    def seconds(self) -> float:
        """That playing takes in a film."""
        return self.editing + self.spent * (1.0 + self.left_out / max(self.played, 1))

    def player(self, scene, session) -> Player:
        """Plays a session so."""
        player = _Player(scene, session)
        player.hurry = self
        return player


class _Player(Player):
    hurry: Hurry

    def adapting(self, tick):
        self._leave_out(tick - self.scene.journal.tick)
        return ()

    def _step(self, tick):
        hurry, scene = self.hurry, self.scene
        begin, following = time.perf_counter(), self.following
        until = tick if following is None else min(tick, following)
        ticks = until - scene.journal.tick
        if ticks > 0 and hurry.spent >= PLAYING:
            self._leave_out(ticks)
            return True
        moves = ticks > 0 and bool(scene.clock.moving)
        goes_on = super()._step(tick)
        seconds = time.perf_counter() - begin
        hurry.played += moves
        hurry.spent += seconds * moves
        hurry.editing += seconds * (not moves)
        return goes_on

    def _leave_out(self, ticks):
        scene = self.scene
        if scene.timeline.playing:
            self.hurry.left_out += ticks
            scene.timeline.skip(ticks)
        elif scene.clock.moving:
            self.hurry.left_out += min(ticks, SETTLING)
        scene.journal.tick += ticks


def render_seconds(
    stage: Stage, film, options, hurry: Hurry, path: Path, codec: str | None, count: int
) -> float:
    """The seconds that frames of a Film take, as FRAMES of them say, and what leads to them.

    Args:
        hurry: That plays the film's session.
        path: Of the film; nothing is written there.
        count: The number of frames.
    """
    numbers = sorted({int((n + 0.5) / FRAMES * count) for n in range(FRAMES)})
    few = replace(options, samples=min(options.samples, MOST_IMAGES))
    on_cuda = stage.radiance.device.is_cuda
    images = few.samples + WARM_IMAGES if on_cuda else 1 + (few.samples == 1)
    warm = replace(options, samples=images, shutter=0.0)  # other images than the next ones
    stage.canvas.use(stage.size)
    with tempfile.TemporaryDirectory(prefix="deformrf-") as folder:
        video = stage.recorder.writer(Path(folder) / path.name, None, codec, options.transparent)
        stage.recorder.video = video
        try:
            FilmMaker(stage, film, warm).make(numbers[0])
            maker = FilmMaker(stage, film, few)
            for number in numbers:
                maker.make(number)
            maker.finish()
        finally:
            stage.recorder.video = None
            video.close()
    film.show(count - 1)  # what is played until then counts
    seconds = maker.seconds
    made = seconds["rendering"] * options.samples / few.samples + seconds["drawing"]
    encoded = video.encoding_seconds / (thread_count() if not path.suffix else 1)
    # On a CPU the encoder has no processor of its own.
    made = max(made, encoded) if on_cuda else made + encoded
    return hurry.seconds + made / len(numbers) * count


class Estimator:
    """Finds out how long a film takes, once the choices for it stand still.

    Attributes:
        job: The last run of deformrf render --estimate.
    """

    def __init__(self, begin: Callable[[list[str]], FilmJob]):
        """Take a function that begins a FilmJob with arguments."""
        self.job: FilmJob | None = None
        self._begin = begin
        self._wanted, self._since = None, 0.0  # arguments, and since when they stand still

    def follow(self, wanted: list[str] | None) -> None:
        """Called in every frame with the arguments of a film; None: no film is asked for."""
        if wanted != self._wanted:
            self._wanted, self._since = wanted, time.monotonic()
            if self.job is not None:
                self.job.stop()
        is_free = self.job is None or (self.job.stopping and self.job.ended)
        if wanted is not None and is_free and time.monotonic() - self._since >= STILL:
            self.job = self._begin([*wanted, "--estimate"])

    @property
    def line(self) -> str:
        """What is known, for people."""
        if self._wanted is None:
            return ""
        if self.job is None or self.job.stopping or not self.job.ended:
            return "estimating ..."
        if self.job.estimate is None:
            return self.job.problem
        seconds, frames = self.job.estimate
        return f"about {spoken(seconds)}, {frames} frames"
