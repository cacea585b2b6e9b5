"""Masks by a program of the user's choice: `deformrf train PHOTOS --mask-with "PROGRAM ARG ..."`.

The command line alone names it: no data set, model, checkpoint or setting can.  It runs once for
each photograph, without a shell, and is given no file of the user's: it reads an upright PNG file
in the work folder, and writes an image beside it, which is opened as a stranger's.

Programs that segment single photographs err in some, so what they say are mattes (mattes.py), which
are made anew where another program is named; masks are what is left after the votes of all views.
"""

import hashlib
import os
import re
import shlex
import shutil
import signal
import subprocess
import threading
import time
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import suppress
from pathlib import Path

import numpy as np
from PIL import Image, ImageChops

from ...core.base.device import thread_count
from ...core.base.images import ImageError, open_image, rgba
from ...core.base.streams import one_line
from ...core.training import have_one_shape, without_classes
from .library import POLL_SECONDS
from .mattes import BACKGROUND, OBJECT, UNKNOWN
from .photos import CaptureError, read_photo
from .turntable import TURNS, size_of
from .work import Work, name_of

INPUT, OUTPUT = "{in}", "{out}"
# For one photograph; the first run of a program may download a network's weights.
FIRST_SECONDS, SECONDS = 900.0, 120.0
AT_ONCE, THREADS_EACH = 4, 4  # programs, most of whose time one thread loads a network
SLOWER = 4.0  # times the seconds of the first, by the calls at once, that others may take
WIDER = 4  # times as wide as the photograph a mask may be
TINT = 16  # of 255: colors that differ by more are not gray
HAZE = 64  # of 255: what is less the object's is background
SAID = 4096  # bytes of what a program says on stderr that are kept, the last ones


class ProgramError(Exception):
    """What the program did wrong, to be put behind its name."""


def program_words(command: str, is_windows: bool = os.name == "nt") -> tuple[str, ...]:
    """Split a command as a shell does; no variable or wildcard means anything.

    On Windows a backslash is a character like others, since paths have it.

    Raises:
        CaptureError: It can't be split, the program is not there, or one of {in} and {out} lacks.
    """
    lexer = shlex.shlex(command, posix=True)
    lexer.whitespace_split, lexer.commenters = True, ""
    if is_windows:
        lexer.escape = ""
    try:
        words = tuple(lexer)
    except ValueError:
        raise CaptureError(
            f"--mask-with {command}: a quotation mark, or a backslash at the end, stands alone"
        ) from None
    if not words or not words[0]:
        raise CaptureError("--mask-with is empty: name a program and its arguments")
    if shutil.which(words[0]) is None:
        raise CaptureError(
            f"--mask-with: there is no program {words[0]}: install it, or give its whole path"
        )
    has_input, has_output = (any(name in word for word in words) for name in (INPUT, OUTPUT))
    if has_input != has_output:
        there, lacks = (INPUT, OUTPUT) if has_input else (OUTPUT, INPUT)
        raise CaptureError(
            f"--mask-with {command}: {there} is there, but not {lacks}: name both, or neither if "
            f"the two files come last"
        )
    return words if has_input else (*words, INPUT, OUTPUT)


def digest_of(words) -> str:
    """What a work folder remembers of a program: words may have keys that nobody else should."""
    return hashlib.sha256("\0".join(words).encode("utf-8", "surrogateescape")).hexdigest()


def make_mattes(work: Work, words, begin):
    """Run the program for each photograph that has no matte yet, and write its matte.

    Args:
        words: By program_words.
        begin: Phases.phase.

    Raises:
        CaptureError: The program failed, or wrote no mask.
    """
    todo = [n for n in range(len(work.photos)) if work.matte(n, made=True) is None]
    done, total, stop = len(work.photos) - len(todo), len(work.photos), threading.Event()
    at_once = min(AT_ONCE, max(1, thread_count() // THREADS_EACH))
    pool = ThreadPoolExecutor(at_once)
    with begin("Masking photographs", total, done) as advance:
        try:
            # The first alone: several would download the same weights.
            begun, seconds = time.monotonic(), FIRST_SECONDS
            for numbers in (todo[:1], todo[1:]):
                running = {pool.submit(make_matte, work, n, words, seconds, stop) for n in numbers}
                while running:
                    ended, running = wait(running, POLL_SECONDS, FIRST_EXCEPTION)
                    for future in ended:
                        future.result()
                    done += len(ended)
                    advance(done)
                seconds = max(SECONDS, SLOWER * at_once * (time.monotonic() - begun))
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)


def make_matte(work: Work, number: int, words, seconds: float, stop: threading.Event):
    """Run the program for one photograph; nothing is written if that can't be read.

    Raises:
        CaptureError: See make_mattes.
    """
    photo, size = work.photos[number], size_of(work, number)
    try:
        rgb = read_photo(photo, max(size))
    except ImageError:  # as find_features will tell
        return
    with work.temporary_folder() as folder:
        source = Path(os.path.abspath(folder), f"{name_of(number)}.png")
        target = source.with_name(f"{name_of(number)}-mask.png")
        Image.fromarray(rgb).resize(size).save(source, compress_level=1)
        paths = {INPUT: str(source), OUTPUT: str(target)}
        filled = [re.sub(r"\{in\}|\{out\}", lambda found: paths[found[0]], word) for word in words]
        try:
            run_program(filled, seconds, stop)
            mask = read_made(target, size)
        except ProgramError as error:
            raise CaptureError(f"--mask-with: for {photo.path.name}, {words[0]} {error}") from None
    work.keep_matte(number, matte_of(mask), made=True)


def run_program(words, seconds: float, stop: threading.Event):
    """Run a program to its end, or end it when `stop` is set.

    Raises:
        ProgramError: It can't be started, takes longer, or says that it failed.
    """
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    try:
        process = subprocess.Popen(words, start_new_session=os.name == "posix", **pipes)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ProgramError(f"can't be started: {reason}") from None
    said, until = bytearray(), time.monotonic() + seconds
    reader = threading.Thread(target=keep_end, args=(process.stderr, said), daemon=True)
    reader.start()
    try:
        while process.poll() is None and not stop.is_set():
            if time.monotonic() > until:
                raise ProgramError(f"took more than {seconds:g} s")
            with suppress(subprocess.TimeoutExpired):
                process.wait(POLL_SECONDS)
    finally:
        end(process)
        reader.join(5 * POLL_SECONDS)  # longer only if something that left its group lives on
    if process.returncode:
        code = process.returncode
        how = f"failed with exit code {code}" if code > 0 else f"was ended by signal {-code}"
        lines = said.decode("utf-8", "replace").split("\n")
        last = next((line for line in reversed(lines) if line.strip()), "it said nothing")
        raise ProgramError(f"{how}: {one_line(last)}")


def keep_end(stream, said: bytearray):
    """Read a stream to its end; keep the last bytes."""
    with stream:
        while chunk := stream.read1(SAID):
            said += chunk
            del said[:-SAID]


def end(process: subprocess.Popen):
    """End a process, and all that it has started where that is known, though it may have ended."""
    with suppress(ProcessLookupError, PermissionError):  # macOS says the latter of who has ended
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    process.wait()


def read_made(path: Path, size) -> np.ndarray:
    """The mask that a program wrote, 0 to 255: its alpha, or its gray values.  [h, w] uint8

    Args:
        size: Width and height of the photograph that it was given; the mask is brought to it.

    Raises:
        ProgramError: There is no file, or no mask in it.
    """
    if not os.path.lexists(path):
        raise ProgramError(f"wrote no file where {OUTPUT} stands")
    try:
        with open_image(path) as file:
            if not have_one_shape(file.size, size) or file.size[0] > WIDER * size[0]:
                given, got = "{}x{}".format(*size), "{}x{}".format(*file.size)
                raise ImageError(f"{path} has {got} pixels, where {given} were given")
            has_alpha = "A" in file.mode or "transparency" in getattr(file, "info", {})
            *colors, alpha = rgba(file).split()
    except ImageError as error:
        raise ProgramError(f"wrote no mask: {str(error).replace(str(path), 'its file')}") from None
    tints = [ImageChops.difference(colors[0], other).getextrema()[1] for other in colors[1:]]
    if max(tints) <= TINT and alpha.getextrema()[0] == 255:
        has_alpha = False  # a gray mask, saved with an alpha that tells nothing
    if not has_alpha and max(tints) > TINT:
        raise ProgramError("wrote a colored image without alpha, which tells no object")
    mask = without_classes(alpha if has_alpha else colors[0])
    return np.asarray(mask.resize(size, Image.Resampling.BOX))


def matte_of(mask) -> np.ndarray:
    """The matte that a program's mask is; an empty or a full one tells nothing.  [h, w] uint8"""
    if not TURNS <= (mask > 127).mean() <= 1.0 - TURNS:
        return np.full_like(mask, UNKNOWN)
    shares = UNKNOWN + 1 + (OBJECT - UNKNOWN - 1) * (mask / 255.0)
    return np.where(mask < HAZE, BACKGROUND, shares.round()).astype(np.uint8)
