"""What deformrf-view can be told, and what follows from it; light, so that --help is quick."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from ..core.arguments import Count, File, at_least, writable_file
from ..core.device import Choice
from ..core.paths import DEFAULT_MODEL
from ..core.render import Mode

WINDOW_SIZE, HEADLESS_SIZE = (1200, 800), (400, 400)
HEADLESS_FRAMES = 90
SMALLEST_SIDE, LARGEST_SIDE = 32, 8192

AnyModel = Annotated[  # may be left out, unlike deformrf-eval's
    tyro.conf.Positional[Path], tyro.conf.arg(metavar="[MODEL]", help_behavior_hint="")
]
Size = Annotated[str | None, tyro.conf.arg(metavar="WxH", help_behavior_hint="")]
Drag = Annotated[str | None, tyro.conf.arg(metavar="VERTEX:DX,DY,DZ", help_behavior_hint="")]
Flag = Annotated[bool, tyro.conf.arg(help_behavior_hint="")]


@dataclass(frozen=True)
class RunArguments:
    """What to do without a mouse."""

    headless: Flag = False
    """Render into the files of --record and --screenshot, without a display."""
    frames: Count = None
    """End after that many frames (90 if headless)."""
    drag: Drag = None
    """Headless: drag a vertex by an offset [model units, the object is about 1 wide] in the
    first third of the frames, hold it in the second, let it go in the third. VERTEX is an id,
    or the word top: the highest control vertex that is not pinned."""
    record: File = None
    """Write an MP4 of the run."""
    screenshot: File = None
    """Write a PNG of the last frame; with --drag, of the last one before it is let go."""
    transparent: Flag = False
    """The PNG shows the field alone, with its opacity as alpha."""


@dataclass(frozen=True)
class ViewArguments:
    """Grab red control vertices of an object and bend it."""

    model: AnyModel = DEFAULT_MODEL
    """Model file, an .npz; the bundled one by default."""
    device: Choice = "auto"
    """auto takes CUDA if there is any."""
    size: Size = None
    """Size of the window [points], 1200x800 by default, or, headless, of the frames [pixels],
    400x400 by default."""
    mode: Mode = "color"
    """What the picture shows; error is that against the exact mode of rendering."""
    fps: Annotated[int, tyro.conf.arg(metavar="N")] = 30
    """Frames per second of clips."""
    interop: Literal["auto", "buffer", "copy"] = "auto"
    """How CUDA frames reach OpenGL: a shared buffer, or a copy through host memory."""
    log_events: Flag = False
    """Print one JSON line per event: ready, state, grab, release, orbit, resize, ..."""
    version: Flag = False
    """Print the version."""
    doctor: Flag = False
    """Print versions, OpenGL, CUDA, how frames reach OpenGL, the video encoder."""
    run: RunArguments = field(default_factory=RunArguments)


def parse(arguments: list[str] | None = None) -> ViewArguments:
    """The command line; exits by itself on --help and on what it does not understand."""
    return tyro.cli(
        ViewArguments,
        prog="deformrf-view",
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
    )


def check(arguments: ViewArguments) -> None:
    """Raise a ValueError for what can be known to be wrong before any work."""
    run = arguments.run
    frame_size(arguments)
    at_least(1, "--fps", arguments.fps)
    if run.frames is not None:
        at_least(1, "--frames", run.frames)
    if run.drag is not None and not run.headless:
        raise ValueError("--drag plays without a mouse: it needs --headless")
    if run.headless and run.record is None and run.screenshot is None:
        raise ValueError("--headless writes files: it needs --record or --screenshot, or both")
    if run.transparent and run.screenshot is None:
        raise ValueError("--transparent is about a picture: it needs --screenshot")
    if run.record is not None:
        _can_write(run.record, ".mp4")
    if run.screenshot is not None:
        _can_write(run.screenshot, ".png")


def _can_write(path, ending):
    try:
        writable_file(path, ending)
    except OSError as error:
        raise ValueError(f"can't write {path}: {error.strerror}") from error


def frame_size(arguments: ViewArguments) -> tuple[int, int]:
    """Width and height of window or frames.

    Raises:
        ValueError: --size is no size, or one that no window has.
    """
    if arguments.size is None:
        return HEADLESS_SIZE if arguments.run.headless else WINDOW_SIZE
    width, _, height = arguments.size.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise ValueError(f"--size is '{arguments.size}'; write it as in 800x600")
    size = int(width), int(height)
    if min(size) < SMALLEST_SIDE or max(size) > LARGEST_SIDE:
        raise ValueError(
            f"--size is {arguments.size}; both sides have to be {SMALLEST_SIDE} to {LARGEST_SIDE}"
        )
    return size
