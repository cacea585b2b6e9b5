"""Processes that read mutants, and the one that watches them.

A worker is forked, makes mutant after mutant of a kind in a folder each, and reads it.  Before and
after each it says so through a pipe.  The watcher compares the worker's memory and processor time
with the limits, and kills it beyond them; what a signal ends is a fault, too.  A mutant is made of
the seed, the kind and its number alone, so that it can be made again.
"""

import faulthandler
import json
import os
import re
import resource
import select
import shutil
import signal
import sys
import time
import traceback
import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import deformrf.core

ROOT = Path(deformrf.core.__file__).resolve().parents[1]
OWN = type(None), ValueError, OSError  # what may be behind a refusal: its words are ours
LONGEST = 5.0  # s of processor time that a mutant may take
BLOCKED = 10.0  # s on the clock in which nothing was computed
MOST_MEMORY = 500  # MB beyond what the worker had before
MOST_ADDRESSES = 6000  # MB: what even the watcher would see too late
LONGEST_SENTENCE = 600  # characters, without the folder's name
KEPT = 3  # mutants of one fault
LOOK = 0.02  # s between two looks
PAGE = os.sysconf("SC_PAGE_SIZE")
TICKS = os.sysconf("SC_CLK_TCK")


class Refused(Exception):
    """A mutant was refused in words that are no exception of the program: preferences."""


@dataclass
class Summary:
    """What became of the mutants of a kind.

    Attributes:
        faults: How many mutants had each fault, by what is the same of them.
        told: Refusals behind which there was any error: of kinds that tell all as a sentence.
        kept: For each fault, mutants that were kept: (folder, what was done to it, details).
        slowest, largest: The largest value, and which mutant it was.
    """

    kind: str
    accepted: int = 0
    refused: int = 0
    faults: Counter = field(default_factory=Counter)
    told: Counter = field(default_factory=Counter)
    kept: dict = field(default_factory=dict)
    slowest: tuple = (0.0, "")
    largest: tuple = (0.0, "")
    seconds: float = 0.0

    @property
    def mutants(self) -> int:
        return self.accepted + self.refused + self.faults.total()


def random_of(seed: int, kind: str, number: int):
    """The generator that makes a mutant."""
    return np.random.default_rng([seed, zlib.crc32(kind.encode()), number])


# -- in the worker -----------------------------------------------------------------------------


def status(pid="self") -> tuple[float, float]:
    """Memory now and at most [MB]."""
    text = Path(f"/proc/{pid}/status").read_text()
    return tuple(int(re.search(rf"{n}:\s+(\d+)", text)[1]) / 1024 for n in ("VmRSS", "VmHWM"))


def forget_peak():
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")


def outcome(kind, folder: Path) -> tuple[str, str, str]:
    """What became of a mutant: "accepted", "refused" or "fault", which one, and details."""
    try:
        kind.read(folder)
        return "accepted", "", ""
    except (*kind.errors, Refused) as error:
        sentence = str(error)
        plain = sentence.replace(str(folder), "")
        if not plain.strip() or not plain.isprintable() or len(plain) > LONGEST_SENTENCE:
            reason = "long" if plain.isprintable() else "unprintable"
            reason = reason if plain.strip() else "empty"
            fault = f"{reason} sentence: {type(error).__name__} {where(error)}"
            return "fault", fault, sentence[:3000]
        cause, behind = error.__cause__, ""
        if getattr(kind, "tells_all", False) and not isinstance(cause, OWN):
            behind = f"{type(cause).__name__} {where(cause)}"
        return "refused", behind, sentence
    except BaseException as error:
        return "fault", f"{type(error).__name__} {where(error)}", traceback.format_exc()[-3000:]


def is_ours(file: str) -> bool:
    """Whether a file is the program's own code, without its tests."""
    path = Path(file)
    return any(path.is_relative_to(ROOT / f) for f in ("core", "wings", "commands", "viewer"))


def where(error) -> str:
    """The last place in the program's own code that an error came through."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if is_ours(f.filename)]
    if isinstance(error, AssertionError) and not frames:
        return str(error).replace("\n", " ")[:60]
    return f"in {Path(frames[-1].filename).name}:{frames[-1].name}" if frames else "elsewhere"


def work(make_kind, name, seed, first, folder: Path, send):
    """Make and read mutants, until somebody ends the process."""
    faulthandler.register(signal.SIGUSR1, all_threads=True)
    faulthandler.enable()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    kind = make_kind(folder / "bases")
    original = folder / "original"
    original.mkdir()
    kind.original(original)
    found = outcome(kind, original)
    if found[0] != "accepted":
        send(failed=f"the undamaged {name} is not read: {found}")
        return
    addresses = int(Path("/proc/self/statm").read_text().split()[0]) * PAGE
    most = addresses + MOST_ADDRESSES * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    number = first
    while True:
        mutant = folder / f"{number}"
        mutant.mkdir()
        what = kind.mutate(random_of(seed, name, number), mutant)
        forget_peak()
        memory, start = status()[0], time.process_time()
        send(begin=number, what=what, memory=memory, start=start)
        result, fault, details = outcome(kind, mutant)
        seconds, grown = time.process_time() - start, status()[1] - memory
        if result != "fault" and (seconds > LONGEST or grown > MOST_MEMORY):
            # The watcher did not see it in time.
            limit = "5 s" if seconds > LONGEST else "500 MB"
            result, fault = "fault", f"{result} after more than {limit}"
            details = f"{seconds:.1f} s, {grown:.0f} MB"
        if result != "fault":
            shutil.rmtree(mutant, ignore_errors=True)
        send(end=number, result=result, fault=fault, details=details, seconds=seconds, grown=grown)
        number += 1


# -- in the watcher ----------------------------------------------------------------------------


class Worker:
    """A forked process, and what it last said."""

    def __init__(self, make_kind, name, seed, first, folder: Path):
        folder.mkdir(parents=True)
        (folder / "bases").mkdir()
        self.log = folder / "log"
        reading, writing = os.pipe()
        self.pid = os.fork()
        if self.pid == 0:
            _child(make_kind, name, seed, first, folder, reading, writing)
        os.close(writing)
        self.pipe, self._rest, self.now = reading, b"", None
        self.folder, self.born = folder, time.monotonic()
        self.seconds = self.grown = 0.0  # of its mutant, so far

    def messages(self, patience):
        """What it has said meanwhile; None at its end."""
        if not select.select([self.pipe], [], [], patience)[0]:
            return []
        data = os.read(self.pipe, 2**16)
        if not data:
            return None
        *lines, self._rest = (self._rest + data).split(b"\n")
        return [json.loads(line) for line in lines]

    def beyond(self) -> str:
        """Which limit its mutant has passed; empty if none."""
        if self.now is None:
            return "made no mutant in 120 s" if time.monotonic() - self.born > 120.0 else ""
        try:
            memory = int(Path(f"/proc/{self.pid}/statm").read_text().split()[1]) * PAGE / 2**20
            fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        except (OSError, IndexError):
            return ""
        self.seconds = (int(fields[11]) + int(fields[12])) / TICKS - self.now["start"]
        self.grown = memory - self.now["memory"]
        if self.grown > MOST_MEMORY:
            return f"more than {MOST_MEMORY} MB"
        if self.seconds > LONGEST:
            return f"more than {LONGEST:.0f} s"
        now, (before, since) = time.monotonic(), self.now.setdefault("computed", (0.0, 0.0))
        if self.seconds > before + 1.0 / TICKS or not since:
            self.now["computed"] = self.seconds, now
            return ""
        return "blocked" if now - since > BLOCKED else ""

    def end(self) -> str:
        """Kill it, unless it has ended; says how it ended."""
        try:
            os.kill(self.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        _, how = os.waitpid(self.pid, 0)
        os.close(self.pipe)
        signaled = os.WIFSIGNALED(how)
        return f"signal {os.WTERMSIG(how)}" if signaled else f"exit {os.WEXITSTATUS(how)}"

    def place(self) -> str:
        """Where in the program it is, by its own word."""
        size = self.log.stat().st_size
        os.kill(self.pid, signal.SIGUSR1)
        time.sleep(0.2)
        return self.frames(size)

    def frames(self, first=0) -> str:
        text = self.log.read_bytes()[first:].decode(errors="replace")
        found = re.findall(r'File "([^"]*)", line \d+ in (\w+)', text)
        own = [f"{Path(file).name}:{name}" for file, name in found if is_ours(file)]
        return f"in {own[0]}" if own else "elsewhere"


def _child(make_kind, name, seed, first, folder, reading, writing):
    """The worker's life; never returns."""
    try:
        os.close(reading)
        log = os.open(folder / "log", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(log, 1)
        os.dup2(log, 2)
        sys.stdout = sys.stderr = open(2, "w", buffering=1, closefd=False)

        def send(**message):
            data = (json.dumps(message) + "\n").encode()
            while data:
                data = data[os.write(writing, data) :]

        try:
            work(make_kind, name, seed, first, folder, send)
        except BaseException:
            send(failed=traceback.format_exc())
    finally:
        os._exit(0)


def run(make_kind, name, seed, folder: Path, seconds, most=None, until=None, first=0):
    """Read mutants of a kind for so many seconds, or until there are `most`; returns a Summary.

    Args:
        make_kind: Makes the kind in a folder of its own; called in the worker.
        folder: Where mutants with faults are kept.
        until: A function of the Summary: whether it is enough.
    """
    summary, start, number, worker = Summary(name), time.monotonic(), first, None
    turn = 0
    try:
        while True:
            if worker is None:
                worker = Worker(make_kind, name, seed, number, folder / f"{name}-worker{turn}")
                turn += 1
            messages = worker.messages(LOOK)
            for message in messages or ():
                if "failed" in message:
                    raise RuntimeError(message["failed"])
                if "begin" in message:
                    worker.now = message
                else:
                    _count(summary, message, worker, folder, seed)
                    number, worker.now = message["end"] + 1, None
                    worker.born = time.monotonic()
            limit = "" if messages is None else worker.beyond()
            if messages is None or limit:
                place = worker.place() if limit else worker.frames()
                ended, log = worker.end(), worker.log.read_text(errors="replace")[-3000:]
                if worker.now is None:
                    raise RuntimeError(f"the worker of {name} ended: {limit} {log}")
                said = limit or ended
                _count(summary, _killed(worker, said, place, log), worker, folder, seed)
                number = worker.now["begin"] + 1
                shutil.rmtree(worker.folder, ignore_errors=True)
                worker = None
            done = time.monotonic() - start > seconds or (most and summary.mutants >= most)
            if done or (until and until(summary)):
                break
    finally:
        if worker is not None:
            worker.end()
            shutil.rmtree(worker.folder, ignore_errors=True)
    summary.seconds = time.monotonic() - start
    return summary


def _killed(worker, said, place, log):
    """The message of a worker that could not send one."""
    return {
        "end": worker.now["begin"],
        "result": "fault",
        "fault": f"{said} {place}",
        "details": log,
        "seconds": worker.seconds,
        "grown": worker.grown,
    }


def _count(summary, message, worker, folder, seed):
    """Add a mutant to the summary, and keep its folder if it has a fault."""
    number, what = message["end"], worker.now["what"]
    summary.slowest = max(summary.slowest, (message["seconds"], f"{number}: {what}"))
    summary.largest = max(summary.largest, (message["grown"], f"{number}: {what}"))
    if message["result"] != "fault":
        setattr(summary, message["result"], getattr(summary, message["result"]) + 1)
        if message["fault"]:
            summary.told[message["fault"]] += 1
        return
    fault = message["fault"]
    summary.faults[fault] += 1
    kept = summary.kept.setdefault(fault, [])
    if len(kept) >= KEPT:
        shutil.rmtree(worker.folder / f"{number}", ignore_errors=True)
        return
    place = folder / f"{summary.kind}-{seed}-{number}"
    shutil.rmtree(place, ignore_errors=True)
    shutil.move(worker.folder / f"{number}", place)
    kept.append((str(place), what, message["details"]))
    about = {"kind": summary.kind, "seed": seed, "number": number, "what": what, "fault": fault}
    place.with_suffix(".json").write_text(json.dumps(about | {"details": message["details"]}))
