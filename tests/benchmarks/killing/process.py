"""A program in a process of its own, which gets a signal at a chosen moment.

The process is forked from one that has imported the commands, so that a run takes as long as its
work.  Python's audit events tell when it opens, renames or removes something in the trial's folder:
a moment is a time since the run began, or since one of these events, so that the writing is met on
a machine of any speed.
"""

import itertools
import multiprocessing
import os
import select
import signal
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

PRELOADED = [
    "torch._dynamo",
    "deformrf.commands.report",
    "deformrf.wings.lab.report.writing",
    "deformrf.commands.edit",
    "deformrf.commands.rig",
    "deformrf.core.training.trainer",
    "deformrf.commands.view",
    "deformrf.commands.render",
    "deformrf.commands.train",
    "deformrf.viewer.document.sessions",
]
PATIENCE = 120.0  # s that a run may take, and that the answer to a signal may take
EVENTS = {"open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link"}
AS_IN_A_TERMINAL = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}
FIRST = "begun"  # the first event of a run


@dataclass(frozen=True)
class Job:
    """What a process does: `call(*arguments)`, a function of a module; by default a command's."""

    arguments: tuple
    call: object = None


@dataclass(frozen=True)
class Moment:
    """When the signal comes: so many seconds after an event, by number; 0 is the run's begin.

    Without a second between, the process sends it to itself, before what the event tells of.
    """

    event: int
    seconds: float


@dataclass
class Ended:
    """How a run ended.

    Attributes:
        code: Exit code, negative for a signal that nothing caught.
        said: On both streams.
        events: Seconds since the begin, and what was touched, of each.
        seconds: How long it took.
        sent_at: When the signal came [s]; None: the run was over.
        number: That signal.
        answered: Seconds from there to the end.
    """

    code: int = 0
    said: str = ""
    events: list = field(default_factory=list)
    seconds: float = 0.0
    sent_at: float | None = None
    number: int = 0
    answered: float = 0.0


def fork_server():
    """The context in which processes start quickly."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    return context


class Run:
    """A process that does a job, from its start to its end."""

    def __init__(self, context, job: Job, said: Path, watched: Path, moment=None, number=0):
        """Start it.

        Args:
            said: File for what it says.
            watched: Folder that events are of.
            moment: When it gets a signal, if at all.
            number: That signal.
        """
        self._said, self._moment, self._number = said, moment, number
        said.unlink(missing_ok=True)
        self._pipe, sending = context.Pipe(duplex=False)
        self._rest = b""
        self.ended = Ended()
        own = (moment.event, number) if moment and not moment.seconds else (-1, 0)
        inputs = job, sending, said, str(watched), own
        self.process = context.Process(target=_work, args=inputs)
        self.process.start()
        sending.close()
        self._begun = None

    def wait(self) -> Ended:
        """Send the signal at its moment, if that comes; returns how the process ended."""
        ended, limit = self.ended, time.monotonic() + PATIENCE
        while True:
            now, due = time.monotonic(), self._due()
            if due is not None and now >= due:
                if self._moment.seconds:
                    os.kill(self.process.pid, self._number)
                ended.sent_at, ended.number = due - self._begun, self._number
                limit = now + PATIENCE
                continue
            if now > limit:
                self.process.kill()
                self.process.join()
                ended.code, ended.said = 1, "it does not end"
                return ended
            left = (limit if due is None else min(due, limit)) - now
            if select.select([self._pipe], [], [], max(left, 0.0))[0] and not self._read():
                break
        self.process.join()
        over = time.monotonic()
        ended.code, ended.seconds = self.process.exitcode, over - (self._begun or over)
        if ended.sent_at is not None:
            ended.answered = ended.seconds - ended.sent_at
        ended.said = self._said.read_text("utf-8", "replace") if self._said.exists() else ""
        return ended

    def kill(self):
        self.process.kill()

    def _due(self):
        """The time at which the signal is to be sent; None if nothing is known of it, or sent."""
        events, moment = self.ended.events, self._moment
        if moment is None or self.ended.sent_at is not None or len(events) <= moment.event:
            return None
        return self._begun + events[moment.event][0] + moment.seconds

    def _read(self):
        """Take events from the pipe; whether more can come."""
        data = os.read(self._pipe.fileno(), 2**16)
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            seconds, _, what = line.decode().partition(" ")
            self._begun = self._begun or float(seconds)
            self.ended.events.append((float(seconds) - self._begun, what))
        return bool(data)


def _work(job, sending, said, watched, own):
    """In the new process: do the job, and tell of what it touches."""
    descriptor = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    told, numbers = sending.fileno(), itertools.count()

    def tell(what):
        os.write(told, f"{time.monotonic():.6f} {what}\n".encode()[:500])
        if next(numbers) == own[0]:
            os.kill(os.getpid(), own[1])

    def hook(event, arguments):
        if event in EVENTS and isinstance(arguments[0], (str, os.PathLike)):
            path = os.fspath(arguments[0])
            if isinstance(path, str) and path.startswith(watched):
                tell(f"{event} {os.path.basename(path)}")

    for number, handler in AS_IN_A_TERMINAL.items():  # this program may run in the background
        signal.signal(number, handler)
    tell(FIRST)
    sys.addaudithook(hook)
    (job.call or command)(*job.arguments)


def command(program, *arguments):
    from deformrf.commands.entry import begin

    sys.argv = [program, *map(str, arguments)]
    sys.exit(begin(program))


def moments(measured: Ended, count: int, rng) -> list[Moment]:
    """Moments that cover a run: by time, at its events, and between one and the next, in turns.

    Args:
        measured: The same run to its end.
    """
    chosen, times = [], [seconds for seconds, _ in measured.events]
    for number in range(count):
        share = (number + rng.random()) / count
        if number % 3 == 2 or len(times) < 2:
            chosen.append(Moment(0, 1.03 * share * measured.seconds))
            continue
        event = 1 + min(int(share * (len(times) - 1)), len(times) - 2)
        after = times[event + 1] if event + 1 < len(times) else measured.seconds
        delay = number % 3 * rng.random() * (after - times[event])
        chosen.append(Moment(event, delay))
    return chosen
