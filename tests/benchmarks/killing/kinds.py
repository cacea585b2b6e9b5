"""What all kinds of trials have: a run is measured, then cut off again and again, and looked at."""

import re
import shutil
import signal
from pathlib import Path

from .process import Job, Run, moments

CAUGHT = 130  # exit code of a command after a signal that it caught
ANSWER = 30.0  # s within which a command ends, on a machine with other work


class Fault(Exception):
    """What must not be; the message says it."""


class Kind:
    """Trials of a kind; those of a subclass say what runs, and what its files may be.

    Attributes:
        sends: The signals, in turns.
        told: Trials so far: moment as a share of the run, signal, exit code, result, seconds.
    """

    sends = (signal.SIGKILL,)

    def __init__(self, context, folder: Path, rng):
        self.context, self.rng, self.told = context, rng, []
        self.inputs, self.out, self.folder = folder / "in", folder / "out", folder
        self.inputs.mkdir()
        self.prepare()
        # The first run may compile kernels; the second one says how long it takes.
        for _ in range(2):
            self.lay(0)
            self.measured = self.run(None)
            if self.measured.code or "Traceback" in self.measured.said:
                raise Fault(f"it does not even run: {self.measured.said[-2000:]}")
        self.learn()

    def prepare(self):
        """Write what the trials read."""

    def learn(self):
        """Note what a run to its end gave."""

    def job(self) -> Job:
        raise NotImplementedError

    def put(self, number: int):
        """Put the files into `out` that are there before trial `number`."""

    def look(self, ended) -> str:
        """What a run has left, in a word or two: "old", "new", "absent"; a Fault if it is wrong."""
        raise NotImplementedError

    def lay(self, number):
        shutil.rmtree(self.out, ignore_errors=True)
        self.out.mkdir()
        self.put(number)

    def run(self, moment, number=signal.SIGKILL, name="said", job=None):
        job, said = job or self.job(), self.folder / name
        return Run(self.context, job, said, self.out, moment, number).wait()

    def trials(self, count: int):
        """Do so many trials; yields what each gave."""
        for number, moment in enumerate(moments(self.measured, count, self.rng)):
            self.lay(number)
            ended = self.run(moment, self.sends[(number + number // 3) % len(self.sends)])
            share = 2.0 if ended.sent_at is None else ended.sent_at / self.measured.seconds
            try:
                self.check_end(ended)
                result = self.look(ended)
            except Fault as fault:
                result = f"fault: {fault}"
            except Exception as error:  # what is left can't be read
                result = f"fault: {error!r}"
            self.told.append(
                {
                    "share": round(share, 3),
                    "event": self.place(moment),
                    "signal": signal.Signals(ended.number).name if ended.number else "",
                    "code": ended.code,
                    "result": result,
                    "answered": round(ended.answered, 3),
                }
            )
            yield result

    def place(self, moment) -> str:
        """The event of a moment, as the measured run had it."""
        what = self.measured.events[moment.event][1]
        after = f"{1e3 * moment.seconds:.1f} ms after " if moment.seconds else "before "
        return f"{after}{what}"

    def check_end(self, ended):
        """A Fault for an exit code, a traceback or a wait that no signal explains."""
        about = f"exit code {ended.code} after {signal.Signals(ended.number or 9).name}"
        allowed = {0, -ended.number} | ({CAUGHT} if ended.number != signal.SIGKILL else set())
        if ended.code not in allowed or (ended.sent_at is None and ended.code):
            raise Fault(f"{about}: {ended.said[-1500:]}")
        if "Traceback" in ended.said or "Exception ignored" in ended.said:
            raise Fault(f"{about}, a traceback: {ended.said[-1500:]}")
        if ended.answered > ANSWER:
            raise Fault(f"{about}: it went on for {ended.answered:.0f} s")

    def check_strays(self, ended, *known, folder=None):
        """A Fault for files that nobody asked for; partial ones go, which only SIGKILL leaves."""
        partial = re.compile(r"\..+-[0-9a-f]{8}\.part(\.\w+)?")
        for path in sorted((folder or self.out).iterdir()):
            if path.name in known:
                continue
            if ended.number != signal.SIGKILL or not partial.fullmatch(path.name):
                raise Fault(f"a file {path.name} is left (exit code {ended.code})")
            path.unlink()


class OneFile(Kind):
    """One file is written, half of the times over an older one."""

    name = "model.npz"

    @property
    def path(self):
        return self.out / self.name

    def old(self) -> bytes:
        return b"what was there before"

    def put(self, number):
        self.before = self.old() if self.rng.random() < 0.5 else None
        if self.before is not None:
            self.path.write_bytes(self.before)

    def is_whole(self):
        """A Fault or another exception unless the new file is whole."""
        raise NotImplementedError

    def look(self, ended):
        self.check_strays(ended, self.name)
        if not self.path.exists():
            if self.before is not None or not ended.code:
                raise Fault(f"no file is there, exit code {ended.code}")
            return "absent"
        if self.path.read_bytes() == self.before:
            if not ended.code:
                raise Fault("it says that it is done, but the file is the old one")
            return "old"
        self.is_whole()
        return "new"


class Signals:
    """The same with signals that a command can answer."""

    sends = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
