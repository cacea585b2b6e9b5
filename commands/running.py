"""The run of a command: it prepares, works, and returns an exit code.

A command first prepares: it checks its arguments and files, and an error there ends in one
sentence on stderr and exit code 2.  Then it works.  Ctrl-C ends it with exit code 130, after
it has written the results so far.
"""

import _thread
import errno
import importlib.util
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import contextmanager
from functools import cache
from types import SimpleNamespace

from ..core import training
from ..core.base.arguments import plain_message
from ..core.base.claims import release
from ..core.base.paths import WriteError, program_version
from ..core.base.streams import keep_going, printable
from .dispatch import INPUT_ERROR

FAILED, INTERRUPTED = 1, 130  # exit codes, with INPUT_ERROR
AGAIN_SECONDS = 0.05  # until an interrupt that was lost comes again
# Ctrl-C; SIGTERM comes from batch systems, SIGHUP from a terminal that was closed.
STOPPING = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]
FIRST_SECONDS = 10.0  # how much longer the first of several processes may take to find an error

# What any job may meet, through no fault of the program.
SHORTAGES = {"ENOSPC", "EDQUOT", "EROFS", "EACCES", "EPERM", "EIO", "EMFILE", "ENFILE", "ENOMEM"}
# In the errors of Warp and torch.
OUT_OF_MEMORY = ("Failed to allocate", "out of memory", "DefaultCPUAllocator")
# Packages that may be missing: what each does, and the extra of pyproject.toml that has it.
PACKAGES = {
    "torch": ("trains models", "train"),
    "scipy": ("measures models, and finds objects in photographs", "report"),
    "pycolmap": ("finds the cameras of photographs", "colmap"),  # "train" has it where wheels are
    "matplotlib": ("draws the report's figures", "report"),
    "markdown_it": ("writes the report's page", "report"),
    "lpips": ("computes LPIPS", "lpips"),
    "torchvision": ("has the network of LPIPS", "lpips"),
    "meshio": ("writes .vtu files", "exchange"),
    "pxr": ("writes USD files", "exchange"),
    # Dependencies, which pip may have been told to leave out.
    "pyglet": ("opens the window", ""),
    "moderngl": ("draws in the window", ""),
    "imgui_bundle": ("draws the panels", ""),
    "av": ("writes films", ""),
}


def run(program: str, prepare: Callable[[], Callable[[], int]]) -> int:
    """Prepare a job, do it, return the exit code.

    A user can mend a ValueError or an OSError of the preparation (errors in data sets and models
    are ValueErrors), a lack of memory, disk or open files or a missing package at any time, and of
    the job a DatasetError (training found nothing in the images) and a file that can't be written.
    `run` prints these as one sentence.  Any other error of the job is a fault of the program and
    keeps its traceback.
    """
    keep_going()
    for number in STOPPING:
        # nohup has SIGHUP ignored, a shell SIGINT in what runs in the background.
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    job = None
    try:
        with interrupts_kept():
            job = prepare()
            return job()
    except ModuleNotFoundError as error:
        name = (error.name or "").partition(".")[0]
        if name not in PACKAGES:
            raise
        sentence = how_to_install(name)
    except (ValueError, OSError, MemoryError) as error:
        if job and not _can_be_mended(error):
            raise
        sentence = plain_message(error) or "the memory is too small"  # Python's own is empty
    except RuntimeError as error:
        if not any(words in str(error) for words in OUT_OF_MEMORY):
            raise
        sentence = f"the device's memory is too small ({plain_message(error)})"
    except KeyboardInterrupt:
        if is_first():
            print(f"{program}: interrupted", file=sys.stderr)
        return INTERRUPTED
    finally:
        release()
    if is_first() or _outlives_first():
        complain(program, sentence)
    return INPUT_ERROR


def how_to_install(package: str) -> str:
    """Say what a package of PACKAGES does, and how to get it: the program is on no index."""
    purpose, extra = PACKAGES[package]
    brackets = f"[{extra}]" if extra else ""
    wheel = f"deformrf-{program_version()}-py3-none-any.whl"
    return (
        f"{package}, which {purpose}, is not installed: "
        f'pip install ".{brackets}" in the clone, or pip install "{wheel}{brackets}"'
    )


def require(*packages: str):
    """Check that packages are installed, without the time that importing them takes.

    Raises:
        ModuleNotFoundError: One is not; `run` says how to install it.
    """
    for name in packages:
        if importlib.util.find_spec(name) is None:
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)


@contextmanager
def interrupts_kept():
    """Let an interrupt that falls into a finalizer come again, after the finalizer.

    Python prints what `__del__` and callbacks of C raise, and goes on as if nothing had been.  Warp
    frees its arrays in `__del__`, so that a loop of frames lost a Ctrl-C now and then.
    """
    before, now = sys.unraisablehook, SimpleNamespace(is_owed=False, is_over=False)

    def send():
        time.sleep(AGAIN_SECONDS)
        if now.is_owed and not now.is_over:
            now.is_owed = False
            interrupt()

    def hook(unraisable):
        if unraisable.exc_type is not KeyboardInterrupt:
            before(unraisable)
            return
        # Here it would be lost again.  Nothing of threading's that has a lock: the code below the
        # finalizer may hold it.
        now.is_owed = True
        _thread.start_new_thread(send, ())

    sys.unraisablehook = hook
    try:
        yield
    finally:
        now.is_over = True
        sys.unraisablehook = before
    if now.is_owed:  # the work ended before it came again
        raise KeyboardInterrupt


def _can_be_mended(error) -> bool:
    """Whether a user can mend what ended a job."""
    known = training.DatasetError, MemoryError, WriteError
    number = getattr(error, "errno", None)
    return isinstance(error, known) or errno.errorcode.get(number) in SHORTAGES


def interrupt():
    """Interrupt the main thread as the first of the signals does that Python handles."""
    for number in STOPPING:
        if not callable(signal.getsignal(number)):
            continue
        if hasattr(signal, "pthread_kill"):  # wakes a thread that waits
            signal.pthread_kill(threading.main_thread().ident, number)
        else:
            _thread.interrupt_main(number)
        return


@contextmanager
def interrupts_waiting():
    """Let an interrupt wait until the block has ended: for what is short, and has to be done."""
    asked, before = [], {}
    for number in STOPPING:
        if signal.getsignal(number) == signal.default_int_handler:
            before[number] = signal.signal(number, lambda *_: asked.append(True))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if asked:
        raise KeyboardInterrupt


def load_views(*arguments, **options):
    """`training.load_dataset`; prints its sentences, and how many images were skipped."""
    dataset = training.load_dataset(*arguments, **options)
    for line in dataset.said:
        say_once(line)
    say_missing(dataset.missing, dataset.view_count, dataset.split)
    return dataset


def say_missing(missing, found: int, split: str):
    """Say how many of a split's images are not there, if any."""
    if missing and is_first():
        print(
            f"{len(missing)} of {len(missing) + found} {split} images are missing and were "
            f"skipped, first {printable(missing[0])}",
            file=sys.stderr,
        )


@cache
def say_once(line: str):
    """Print a line on stderr, in the first process; two splits of a data set say the same."""
    if is_first():
        print(printable(line), file=sys.stderr)


def is_first() -> bool:
    """Whether this process prints for all processes that torchrun started."""
    return os.environ.get("RANK", "0") == "0"


def complain(program: str, sentence: str) -> int:
    """Print a sentence on stderr, its beginning in red on a terminal; returns INPUT_ERROR."""
    red, plain = ("\033[1;31m", "\033[0m") if sys.stderr.isatty() else ("", "")
    print(f"{red}{program}:{plain} {printable(sentence)}", file=sys.stderr)
    return INPUT_ERROR


def _outlives_first() -> bool:
    """Whether the first process runs on, so that this process has to report its own error.

    When the first process ends, torchrun sends a signal to the others.
    """
    try:
        time.sleep(FIRST_SECONDS)
    except KeyboardInterrupt:
        return False
    return True
