"""The command deformrf view: parse, check, open a window (or none), run, report.

Ctrl-C and SIGTERM end the video early.  Warp and pyglet are imported when the arguments are known
to be good, so that --help is quick.
"""

import logging
import shlex
import sys
import threading
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from ..core import field as fields
from ..core.base.arguments import (
    Arg,
    Count,
    Demo,
    File,
    Folder,
    Meters,
    Model,
    at_least,
    chosen_model,
    object_size,
    with_size,
    writable_file,
)
from ..core.base.device import Choice, begin_cuda, device_name
from ..core.base.memory import no_garbage_collected
from ..core.base.paths import DEFAULT_MODEL, is_project
from ..core.render import Mode
from ..viewer import logs
from ..viewer.files import Problem, has_native_dialogs, readable
from ..viewer.settings import LARGEST_SIDE, SMALLEST_SIDE
from ..wings import capture
from . import doctor
from .options import parsed
from .running import FAILED, interrupts_waiting, run

log = logging.getLogger(__name__)

PROGRAM = "deformrf view"
SLOW_START = 1.5  # s after which the user is told what takes so long
HEADLESS_SIZE = 400, 400

Size = Annotated[str | None, Arg("WxH")]
Drag = Annotated[str | None, Arg("VERTEX:DX,DY,DZ")]


@dataclass(frozen=True)
class RunArguments:
    """Runs without a mouse."""

    headless: bool = False
    """Render into the files of --record and --screenshot, without a display."""
    frames: Count = None
    """End after that many frames (90 if headless)."""
    drag: Drag = None
    """Headless: drag a vertex by an offset [model units; the object is about 1 wide] in the first
    third of the frames, hold it in the second, let it go in the third. VERTEX is an id, or the word
    top: the highest red point that is not pinned."""
    record: File = None
    """Video of the run to write, a .mp4."""
    screenshot: File = None
    """Picture to write, a .png: the last frame or, with --drag, the last one before it is let
    go."""
    transparent: bool = False
    """Leave the background out of the picture."""


@dataclass(frozen=True)
class InnerArguments:
    """For programs that drive the viewer, and for finding faults."""

    interop: Literal["auto", "buffer", "copy"] | None = None
    """How frames get from CUDA to OpenGL: by a shared buffer, or by a copy through host memory.
    auto, the default, takes the buffer if that works."""
    log_events: bool = False
    """Print one JSON line for each event: ready, state, grab, release, orbit, resize, ..."""


@dataclass(frozen=True)
class PhotographArguments:
    """What the model was trained on."""

    data: Folder = None
    """Folder of the data set; the keys [ and ] jump to its cameras."""
    outside_images: bool = False
    """Read images that lie outside that folder, too."""


@dataclass(frozen=True)
class ViewArguments:
    """Grab the red points of an object and bend it."""

    model: Model = DEFAULT_MODEL
    """Model file, an .npz, or a project, a .deformrf; the bundled helmet by default."""
    demo: Demo = None
    """A bundled model instead: helmet, or fox, which has bones and clips."""
    device: Choice = "auto"
    """Where the work is done; auto, the default, takes CUDA if there is any."""
    size: Size = None
    """Size of the window [points], by default as it was last, at first 1200x800; headless: of
    frames [pixels], by default 400x400."""
    object_size: Meters = None
    """The object's longest side [m]; by default what the model says, else one model unit is 1 m.
    The same material is stiffer for its weight where the object is smaller."""
    session: File = None
    """Begin where this session ended (File > Export > Session saves one)."""
    mode: Mode | None = None
    """View mode, by default color; samples are those along a ray, error is the difference from the
    exact mode of rendering."""
    fps: Annotated[int, Arg("N")] = 30
    """Frames per second of videos of the screen."""
    photographs: PhotographArguments = field(default_factory=PhotographArguments)
    run: RunArguments = field(default_factory=RunArguments)
    inner: InnerArguments = field(default_factory=InnerArguments)


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns its exit code, which the console script passes to sys.exit."""
    words = sys.argv[1:] if arguments is None else arguments
    if "--doctor" in words:  # a command of its own now
        return doctor.main([word for word in words if word == "--headless"])
    chosen = parsed(PROGRAM, ViewArguments, words)
    return run(PROGRAM, lambda: prepare(chosen))


def check(arguments: ViewArguments) -> None:
    """Raise a ValueError for what can be known to be wrong before any work."""
    run = arguments.run
    refuse_data(arguments.model)
    if run.headless:
        refuse_photographs(arguments.model)
    size_of(arguments)
    at_least(1, "--fps", arguments.fps)
    object_size("--object-size", arguments.object_size)
    if arguments.session is not None and arguments.object_size is not None:
        raise ValueError("--session has the object's size: leave --object-size out")
    data = arguments.photographs.data
    if data is not None and not data.is_dir():
        raise ValueError(f"--data is {data}: give the folder of a data set")
    at_least(1, "--frames", run.frames)
    if run.drag is not None and not run.headless:
        raise ValueError("--drag plays without a mouse: it needs --headless")
    if run.headless and run.record is None and run.screenshot is None:
        raise ValueError("--headless writes files: it needs --record or --screenshot, or both")
    if run.transparent and run.screenshot is None:
        raise ValueError("--transparent is about a picture: it needs --screenshot")
    for path, ending in ((run.record, ".mp4"), (run.screenshot, ".png")):
        try:
            if path is not None:
                writable_file(path, ending)
        except OSError as error:
            raise ValueError(f"can't write {path}: {error.strerror}") from error


def with_project(chosen):
    """The arguments; a project is the session, too.

    Raises:
        ValueError: Another session is given.
    """
    if not is_project(chosen.model):
        return chosen
    if chosen.session is not None:
        raise ValueError(f"{chosen.model} has a session of its own: leave --session out")
    return replace(chosen, session=chosen.model)


def opened_by(chosen, session: Path | None):
    """The model that the arguments name, and what a session or a project has; None without.

    Raises:
        ValueError or OSError: A file can't be read, or doesn't fit.
    """
    from ..viewer.document import load_project, open_session

    if is_project(chosen.model):
        opened = load_project(chosen.model)
        return opened.field, opened
    field = with_size(fields.load(chosen.model), chosen.object_size)
    if session is None:
        return field, None
    opened = open_session(session, field, chosen.model)
    return opened.field, opened


def refuse_photographs(model: Path) -> None:
    """Raise a ValueError with the command that makes a model of photographs, if these are any."""
    if holds_photographs(model):
        what = shlex.quote(str(model))
        raise ValueError(
            f"{model} holds photographs, not a model; this trains one of them: "
            f"deformrf train {what} -o model.npz"
        )


def refuse_data(model: Path) -> None:
    """Raise a ValueError with the command that makes a model of a data set, if this is one.

    Photographs whose cameras were found here are asked about, like those without cameras.
    """
    kind, is_file = model.suffix.lower(), model.is_file()
    if kind == ".r3d" and is_file:
        raise ValueError(
            f"{model} is a recording of Record3D, not a model: unzip it (it is a zip), and give "
            f"that folder to deformrf train"
        )
    folder = model.parent if kind == ".json" and is_file else model
    if not folder.is_dir():
        return
    from ..core.training import has_cameras

    if has_cameras(folder) and (is_file or not capture.is_capture(folder)):
        raise ValueError(
            f"{model} is a data set, photographs with their cameras, not a model; this trains one "
            f"of it: deformrf train {shlex.quote(str(folder))} -o model.npz"
        )


def holds_photographs(model: Path) -> bool:
    """Whether a path is a folder of photographs, or a video."""
    from ..core.training import photo_folder

    return capture.is_video(model) or (model.is_dir() and photo_folder(model) is not None)


def size_of(arguments: ViewArguments) -> tuple[int, int]:
    """Width and height of --size, else those of frames; a ValueError if none can have them."""
    if arguments.size is None:
        return HEADLESS_SIZE
    return frame_size(arguments.size)


def frame_size(text: str) -> tuple[int, int]:
    """ "800x600" -> 800, 600; a ValueError if it is written in another way, or no frame is so."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise ValueError(f"--size is '{text}'; write it as in 800x600")
    size = int(width), int(height)
    if min(size) < SMALLEST_SIDE or max(size) > LARGEST_SIDE:
        raise ValueError(
            f"--size is {text}; both sides have to be {SMALLEST_SIDE} to {LARGEST_SIDE}"
        )
    return size


@no_garbage_collected()  # what is loaded is no garbage: a tenth of the start's time
def prepare(chosen: ViewArguments) -> Callable[[], int]:
    """Check the arguments, and show the model in its first pose; returns the work."""
    chosen = with_project(replace(chosen, model=chosen_model(chosen.model, chosen.demo)))
    check(chosen)
    project = chosen.model if is_project(chosen.model) else None
    if chosen.device != "cpu" and chosen.model.exists():
        begin_cuda()
    from ..viewer.script import parse_drag, resolved

    drag = parse_drag(chosen.run.drag) if chosen.run.drag is not None else None
    offered = chosen.model if holds_photographs(chosen.model) else None
    if offered is not None:
        chosen = replace(chosen, model=DEFAULT_MODEL)
    field, opened = opened_by(chosen, chosen.session)
    if opened is not None:
        chosen = replace(chosen, model=opened.source)
    device = device_name(chosen.device)
    kept, problem = _remembered(chosen)
    app = _open(chosen, kept) if offered is None else _open_to_ask(chosen, kept, offered)
    try:
        with told_if_slow(app):
            app.load(field, chosen.model.stem, device, chosen.inner.interop or kept.interop)
        app.scene.source = chosen.model
        if offered is None:
            kept.opened(project or chosen.model)
        else:
            app.offer_training(offered)
        if problem:
            log.warning(problem)
            app.questions.dialog = Problem("The preferences are damaged", problem)
        if opened is not None:
            app.playing.play(opened.session, opened.said, opened if project else None)
        drag = None if drag is None else resolved(drag, app.scene.handles)
        photographs = chosen.photographs
        if photographs.data is not None:
            app.opening.open_photographs(photographs.data, photographs.outside_images)
    except BaseException:
        app.close()
        raise
    if chosen.mode is not None:
        app.scene.settings.mode = chosen.mode
    app.scene.settings.transparent_screenshots = chosen.run.transparent
    return lambda: _show(app, chosen, drag)


def _remembered(chosen):
    """The Preferences, and a sentence if they were damaged; without a window, the defaults."""
    from ..viewer import preferences

    if chosen.run.headless:
        return preferences.Preferences(), ""
    return preferences.load(preferences.file())


def _open(chosen, kept):
    """The App in its window, still empty; raises WindowError without a display or OpenGL."""
    from ..viewer.window import open_window

    headless = chosen.run.headless
    size = size_of(chosen) if headless or chosen.size else kept.window_size
    window, context = open_window(size, headless, f"deformrf: {readable(chosen.model.stem)}")
    from ..viewer.app import App  # imports pyglet's window, which is possible from now on
    from ..viewer.events import EventLog

    events = EventLog(chosen.inner.log_events)
    app = App(window, context, events, gui=not headless, fps=chosen.fps, kept=kept)
    if not headless:
        app.opening.native = has_native_dialogs()
        app.log_file = app.gui.log_file = logs.start(logs.file())
    return app


def _open_to_ask(chosen, kept, data):
    """The App in its window, to ask about photographs; without a display, what to type."""
    from ..viewer.window import WindowError

    try:
        return _open(chosen, kept)
    except WindowError:
        refuse_photographs(data)
        raise


def _show(app, chosen, drag):
    """Show frames until the end, and write the files; returns the exit code."""
    from ..viewer.script import render_files

    run = chosen.run
    try:
        if run.headless:
            app.canvas.use(app.size)
            draw = partial(app.frame, 1.0 / chosen.fps, whole=True)
            render_files(run, drag, app.scene.handles, app.recorder, draw)
        else:
            if run.record is not None:
                app.frame(0.0)  # the canvas has its size from the first frame
                app.recorder.start(run.record)
            app.run(run.frames)
            _remember(app, chosen)
            app.end()
            if run.screenshot is not None:
                app.recorder.screenshot(run.screenshot)
                app.frame(0.0, whole=True)
    except KeyboardInterrupt:  # SIGHUP and SIGTERM, too
        with interrupts_waiting():  # some send two signals, and some users
            for sentence in [] if app.autosave is None else app.autosave.keep():
                app.recorder.say(sentence)
        raise
    except Exception as error:
        if app.autosave is not None:
            app.autosave.keep()
        logs.note(error)
        raise
    finally:
        try:
            app.recorder.stop(cut_short=run.headless)  # unless all frames are in it
        finally:
            app.close()
            logs.stop()
    return FAILED if app.recorder.failed else 0


def _remember(app, chosen):
    """Write the preferences: a size that the command line gave is for this once."""
    from ..viewer import preferences

    kept = app.preferences
    preferences.take(kept, app.scene.settings, app.usual_fps)
    if chosen.size is None:
        preferences.take_window(kept, app.window.get_size())
    problem = kept.save()
    if problem:
        log.warning(problem)


@contextmanager
def told_if_slow(app):
    """Say on stderr what is going on if it takes more than a moment."""

    def tell():
        progress = app.progress
        if progress is not None:
            first = " (on the first start only)" if progress.compiling else ""
            print(f"{progress.stage}{first} ...", file=sys.stderr, flush=True)

    timer = threading.Timer(SLOW_START, tell)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
