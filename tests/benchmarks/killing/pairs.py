"""Two processes write to one place: one whole result of either, and a sentence where one can't."""

import signal
import time

from deformrf.core.field import load

from . import films, finding, models, trainings
from .kinds import Fault
from .process import Run

REFUSED = 1, 2  # exit codes: late, as what is there now can't be replaced, or at once
MOST_LINES = 4  # of which the last one says why


class Two:
    """A kind's job beside another of it, which begins while the first one runs."""

    def jobs(self):
        raise NotImplementedError

    def of(self) -> int:
        """Whose result is there, 0 or 1; a Fault or another exception if it is no whole one."""
        raise NotImplementedError

    def check_pair(self, ended):
        """A Fault for files that none of both should leave."""

    def trials(self, count):
        for number in range(count):
            self.lay(number)
            share = (number + self.rng.random()) / count
            ended = []
            try:
                ended = self.together(share * self.measured.seconds)
                result = self.judged(ended)
            except Fault as fault:
                result = f"fault: {fault}"
            except Exception as error:
                result = f"fault: {error!r}"
            told = {"share": round(share, 3), "event": "the second begins", "signal": ""}
            self.told.append(
                told | {"code": [one.code for one in ended], "result": result, "answered": 0.0}
            )
            yield result

    def together(self, seconds):
        """Both to their ends; the second begins after so many seconds."""
        one, other = self.jobs()
        first = Run(self.context, one, self.folder / "said", self.out)
        time.sleep(seconds)
        second = Run(self.context, other, self.folder / "said 2", self.out)
        return first.wait(), second.wait()

    def judged(self, ended):
        for one in ended:
            lines = one.said.strip().splitlines()
            refused = one.code in REFUSED and 0 < len(lines) <= MOST_LINES
            if (one.code and not refused) or "Traceback" in one.said:
                raise Fault(f"exit codes {[e.code for e in ended]}: {one.said[-1500:]}")
        if all(one.code for one in ended):
            raise Fault(f"both are refused: {ended[0].said} {ended[1].said}")
        self.check_pair(ended)
        whose = self.of()
        if ended[whose].code:
            raise Fault("the result is that of the process that was refused")
        refused = "" if not any(one.code for one in ended) else ", the other one refused"
        return ("first" if whose == 0 else "second") + refused


class TwoEdits(Two, models.Edit):
    def jobs(self):
        self.before = None
        (_, *arguments), small = self.job().arguments, self.second
        return (
            models.Job(("edit", *arguments)),
            models.Job(("edit", small, "-o", self.path, "--specks", 0.0)),
        )

    def of(self):
        self.check_strays(self.measured, self.name)
        return int(load(self.path).mesh.tet_count <= load(self.second).mesh.tet_count)


class TwoFilms(Two, films.Film):
    def jobs(self):
        self.before, one = None, self.job()
        self.shown = "--turntable", 0.5
        other, self.shown = self.job(), films.Film.shown
        return one, other

    def of(self):
        self.check_strays(self.measured, self.name)
        count = self.count()
        if count not in (self.frames, self.frames // 2):
            raise Fault(f"a film of {count} frames")
        return int(count != self.frames)


class TwoPictures(TwoFilms):
    """Films as folders of pictures, which are all of one film."""

    name = "pictures"

    def put(self, number):
        self.before = None

    def learn(self):
        self.films = []
        for number, job in enumerate(self.jobs()):
            if number:
                self.lay(0)
                self.run(None, job=job)
            self.films.append(self.pictures())

    def pictures(self):
        return {path.name: path.read_bytes() for path in self.path.iterdir()}

    def of(self):
        self.check_strays(self.measured, self.name, "pictures.part")
        found = self.pictures()
        if found not in self.films:
            of = [sum(found.get(n) == one[n] for n in one) for one in self.films]
            raise Fault(f"{len(found)} pictures, {of[0]} of the one film and {of[1]} of the other")
        return self.films.index(found)


class TwoTrainings(Two, trainings.Training):
    """Each has a seed of its own; when the first one is done, the second one is killed."""

    def jobs(self):
        return self.job(seed=0), self.job(seed=1)

    def together(self, seconds):
        one, other = self.jobs()
        first = Run(self.context, one, self.folder / "said", self.out)
        time.sleep(seconds)
        second = Run(self.context, other, self.folder / "said 2", self.out)
        ended = first.wait()
        second.kill()
        return ended, second.wait()

    def judged(self, ended):
        killed = ended[1].code == -signal.SIGKILL
        wrote = any("os.rename .model-" in w and "checkpoint" in w for _, w in ended[1].events)
        if killed and wrote:
            step = trainings.load_checkpoint(self.checkpoint)
            if step.options.seed != 1:
                raise Fault("the second run's checkpoint was replaced by the first one's")
            return "the second one's checkpoint is kept"
        if killed:
            if ended[0].code or self.of() != 0:
                raise Fault(f"the first one's result is not there: {ended[0].said}")
            return "first, the other one killed before it wrote"
        return super().judged(ended)

    def of(self):
        if self.checkpoint.exists():
            raise Fault("a checkpoint is left")
        self.is_whole()
        return load(self.path).meta["options"]["seed"]


class TwoFindings(Two, finding.Finding):
    """Of the same photographs, for one model."""

    def jobs(self):
        return self.job(), self.job()

    def judged(self, ended):
        if all(one.code == 0 for one in ended) and "worked at" in ended[1].said:
            raise Fault("both found the cameras, in one folder of work")
        return super().judged(ended)

    def of(self):
        self.check_cameras()
        if self.kept.exists():
            raise Fault("model.capture is left")
        return 0
