"""Programs that write a film: deformrf render of a turn and a session, and deformrf view."""

import av
from fuzzing.models import small_models

from deformrf.core.field import load
from deformrf.viewer.document import Scene, save_session, start_of

from .kinds import Fault, OneFile, Signals
from .process import Job

OPTIONS = "--size", "64x48", "--device", "cpu"
TICKS = 40  # of a session: 20 frames


class Film(OneFile):
    """`deformrf render` films a turn around the object."""

    name = "film.mp4"
    shown = "--turntable", 1.0

    def prepare(self):
        self.model = next(small_models(self.inputs))

    def job(self):
        return Job(("render", self.model, *self.shown, *OPTIONS, "-o", self.path))

    def learn(self):
        self.frames = self.count()

    def count(self, path=None) -> int:
        with av.open(str(path or self.path)) as film:
            return sum(1 for _ in film.decode(video=0))

    def is_whole(self):
        if self.count() != self.frames:
            raise Fault(f"a film of {self.count()} frames has the place of one of {self.frames}")


class SessionFilm(Film):
    """`deformrf render` films a session."""

    def prepare(self):
        super().prepare()
        scene = Scene(load(self.model), self.model.stem, "cpu")
        start = start_of(scene)
        scene.note_view()
        scene.set_ground(True)
        path = self.inputs / "session.jsonl"
        for _ in range(TICKS):
            scene.clock.advance(1.0 / 60.0)
        save_session(scene, start, path)
        self.shown = "--session", path


class Recording(Film):
    """`deformrf view` records what it shows, without a window."""

    def job(self):
        options = "--headless", "--drag", "top:0,0,0.2", "--frames", 30, "--record"
        return Job(("view", self.model, *OPTIONS, *options, self.path))


class Live(Film):
    """The same in a window, as time passes."""

    def job(self):
        options = "--device", "cpu", "--frames", 30, "--record", self.path
        return Job(("view", self.model, *options))

    def is_whole(self):
        if not self.count():
            raise Fault("a film without frames")


class CutShort(Signals):
    """What is there of a film may be kept, under a name that says so."""

    def check_strays(self, ended, *known):
        short = [path.name for path in self.out.glob("* (cut short)*")]
        for name in short:
            if not self.count(self.out / name):
                raise Fault(f"{name} has no frames")
        super().check_strays(ended, *known, *short)


class FilmSignals(CutShort, Film):
    pass


class RecordingSignals(CutShort, Recording):
    pass
