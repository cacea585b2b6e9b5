"""The command deformrf render: a film of a session, without a window and without haste.

The same program as deformrf view draws the frames, each in full.  Ctrl-C ends the film where it
is: the file can be played, and has "(cut short)" in its name.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Literal

from ..core.base.arguments import (
    Arg,
    Count,
    Demo,
    File,
    Meters,
    Model,
    Name,
    Share,
    at_least,
    chosen_model,
    object_size,
    positive,
    writable_file,
)
from ..core.base.claims import claim
from ..core.base.device import Choice, device_name
from ..core.base.paths import DEFAULT_MODEL
from ..core.base.reading import check_file
from ..core.base.streams import printable
from ..core.deform import PRESETS, Material
from ..core.render import Mode
from .options import parsed
from .running import FAILED, complain, run
from .view import frame_size, opened_by, refuse_data, told_if_slow, with_project

PROGRAM = "deformrf render"
SIZE, FPS, MOST_SAMPLES = "1280x720", 30, 256
LONGEST_TURN = 3600.0  # s
MATERIALS = {"default": Material(), **PRESETS}

Seconds = Annotated[float | None, Arg("SECONDS")]
Tick = Annotated[int | None, Arg("TICK")]


@dataclass(frozen=True)
class RenderArguments:
    """Render a session of deformrf view, or a turn around the object, into a file."""

    model: Model = DEFAULT_MODEL
    """Model file, an .npz, or a project, a .deformrf; the bundled helmet by default."""
    demo: Demo = None
    """A bundled model instead: helmet, or fox, which has bones and clips."""
    output: Annotated[File, Arg("FILE", short="-o")] = None
    """File to write, a .mp4, .webm or .webp, or a folder for numbered PNG files."""
    session: File = None
    """A session that deformrf view has saved (File > Export > Session)."""
    timeline: bool = False
    """Show the timeline that the session ends with, from its beginning to its last key."""
    turntable: Seconds = None
    """Turn the camera once around the object in so many seconds; without --session, that is the
    film."""
    clip: Name = None
    """Play this clip of the model's rig, once, or as long as --turntable, --camera or --frames
    say."""
    softness: Share = 0.0
    """Share of the object that physics moves while --clip plays, 0 to 1; at 0 bones move all of
    it."""
    camera: File = None
    """A camera path, a JSON file with keys of positions and targets, or of matrices; or a data set,
    its folder or its transforms.json, whose cameras are the path."""
    pose: File = None
    """Show the object in this pose: of vertices in .npy or .npz, or of a session's last tick."""
    material: Name = None
    """The object is of jelly, rubber, plush, clay, stiff, or default, until the session changes
    that. Without --material it is of what the session says."""
    size: Annotated[str, Arg("WxH")] = SIZE
    """Width and height of the film [pixels]."""
    fps: Annotated[int, Arg("N")] = FPS
    """Frames per second."""
    samples: Annotated[int, Arg("N")] = 1
    """Rays a pixel, from shifted images: 16 make smooth edges."""
    shutter: Share = 0.0
    """Motion blur: spread the --samples over this share of a frame's time, 0 to 1."""
    transparent: bool = False
    """Leave the background out of a .webm (vp9), a .webp or PNG files."""
    first: Annotated[Tick, Arg(name="from")] = None
    """Begin at this tick of the session; a tick is 1/60 s of the object's time."""
    last: Annotated[Tick, Arg(name="to")] = None
    """End at this tick of the session."""
    frames: Count = None
    """End after that many frames."""
    codec: Literal["h264", "h265", "av1", "vp9", "webp"] | None = None
    """The video's encoding; by default h264 for .mp4, vp9 for .webm."""
    hide_handles: bool = False
    """Leave out the red and gray spheres, and bones, which films of a session show."""
    show_handles: bool = False
    """Draw the spheres of control points and pins without a session, too."""
    mode: Mode | None = None
    """View mode, instead of the session's; samples are those along a ray."""
    device: Choice = "auto"
    """Where the work is done; auto, the default, takes CUDA if there is any."""
    object_size: Meters = None
    """The object's longest side [m]; by default what the model says. A session has its own."""
    estimate: bool = False
    """Say how long the film would take, from three of its frames, and write nothing."""
    log_events: bool = False
    """Print one JSON line for each event: recording, frame, written, estimate."""

    GROUPS = {  # noqa: RUF012
        "What moves": (
            "session",
            "timeline",
            "first",
            "last",
            "clip",
            "softness",
            "material",
            "pose",
            "object_size",
        ),
        "The camera": ("camera", "turntable"),
        "The film": ("size", "fps", "frames", "samples", "shutter", "codec", "estimate"),
        "What is shown": ("mode", "transparent", "hide_handles", "show_handles"),
        "For programs that watch the command": ("log_events",),
    }


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    chosen = parsed(PROGRAM, RenderArguments, arguments)
    return run(PROGRAM, lambda: prepare(chosen))


def check(chosen: RenderArguments) -> tuple[int, int]:
    """The size of the film; a ValueError for what can be known to be wrong before any work."""
    size = frame_size(chosen.size)
    if chosen.output is None:
        raise ValueError("give the file to write: -o film.mp4, film.webm, or a folder")
    shown = chosen.session, chosen.clip, chosen.turntable, chosen.camera
    if all(one is None for one in shown):
        raise ValueError(
            "there is nothing to film: give --session, --clip, --turntable or --camera"
        )
    _check_clip(chosen)
    if chosen.timeline and chosen.session is None:
        raise ValueError("--timeline is that of a session: give --session too")
    if chosen.camera is not None and chosen.turntable is not None:
        raise ValueError("--camera and --turntable both move the camera: leave one out")
    if chosen.pose is not None and chosen.session is not None:
        raise ValueError("--session moves the object, so it can't have a --pose")
    if chosen.material is not None and chosen.session is None and chosen.clip is None:
        raise ValueError(
            "--material shows in how a session or a clip moves the object: it needs --session"
        )
    if chosen.material not in (None, *MATERIALS):
        raise ValueError(f"--material is {chosen.material!r}; it is one of {', '.join(MATERIALS)}")
    at_least(1, "--fps", chosen.fps)
    at_least(1, "--samples", chosen.samples)
    if chosen.samples > MOST_SAMPLES:
        raise ValueError(f"--samples is {chosen.samples}; {MOST_SAMPLES} are the most")
    positive("--turntable", chosen.turntable)
    if chosen.turntable is not None and chosen.turntable > LONGEST_TURN:
        raise ValueError(f"--turntable is {chosen.turntable:g} s; {LONGEST_TURN:g} are the most")
    object_size("--object-size", chosen.object_size)
    if chosen.session is not None and chosen.object_size is not None:
        raise ValueError("--session has the object's size: leave --object-size out")
    at_least(1, "--frames", chosen.frames)
    _check_times(chosen)
    for path in filter(None, (chosen.camera, chosen.pose)):
        if path.exists() and not path.is_dir():  # known before a model is loaded for it
            check_file(path)
    _check_output(chosen)
    return size


def _check_clip(chosen):
    """A ValueError unless --clip and --softness make sense."""
    if not 0.0 <= chosen.softness <= 1.0:
        raise ValueError(f"--softness is {chosen.softness:g}; it is a part of the object: 0 to 1")
    if chosen.softness and chosen.clip is None:
        raise ValueError("--softness is about how a clip moves the object: it needs --clip")
    if chosen.show_handles and (chosen.session is not None or chosen.hide_handles):
        raise ValueError(
            "--show-handles is for films without a --session, which show none by default: "
            "leave it out"
        )
    if chosen.clip is not None and (chosen.session is not None or chosen.pose is not None):
        raise ValueError("--clip moves the object: leave --session and --pose out")


def _check_times(chosen):
    """A ValueError unless shutter, --from and --to make sense."""
    if not 0.0 <= chosen.shutter <= 1.0:
        raise ValueError(f"--shutter is {chosen.shutter:g}; it is a part of a frame: 0 to 1")
    if chosen.shutter and chosen.samples == 1:
        raise ValueError("--shutter spreads the images of --samples: give 2 or more, as 16")
    for name, tick in (("--from", chosen.first), ("--to", chosen.last)):
        at_least(0, name, tick)
        if tick is not None and chosen.session is None:
            raise ValueError(f"{name} is a tick of a session: it needs --session")
    if None not in (chosen.first, chosen.last) and chosen.last < chosen.first:
        raise ValueError(f"--to is {chosen.last}, before --from, which is {chosen.first}")


def _check_output(chosen):
    from ..viewer.films import encoder

    path = chosen.output
    if path.suffix:
        encoder(path, chosen.codec, chosen.transparent)
        writable_file(path, path.suffix)
    elif chosen.codec is not None:
        raise ValueError(f"--codec is about a video, but {path} is a folder of pictures")
    elif path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise ValueError(f"{path} has to be a new or an empty folder")
    else:
        claim(path / "00000.png")


def prepare(chosen: RenderArguments) -> Callable[[], int]:
    """Check the arguments, and load the model; returns the work."""
    began = time.perf_counter()
    chosen = with_project(replace(chosen, model=chosen_model(chosen.model, chosen.demo)))
    size = check(chosen)
    refuse_data(chosen.model)
    from ..viewer.document import Player
    from ..viewer.films import Hurry
    from ..viewer.window import open_window

    session, posed = None, chosen.pose is not None and chosen.pose.suffix == ".jsonl"
    field, opened = opened_by(chosen, chosen.pose if posed else chosen.session)
    if opened is not None:
        session = None if posed else opened.session
        chosen = replace(chosen, model=opened.source)
        if opened.said:
            print(printable(opened.said), file=sys.stderr)
    device = device_name(chosen.device)
    window, context = open_window(size, headless=True)
    from ..viewer.app import App  # imports pyglet's window, which is possible from now on
    from ..viewer.events import EventLog

    app = App(window, context, EventLog(chosen.log_events), gui=False, fps=chosen.fps)
    try:
        with told_if_slow(app):
            app.load(field, chosen.model.stem, device)
        hurry = Hurry() if chosen.estimate else None
        loaded = time.perf_counter() - began
        playing = Player if hurry is None else hurry.player
        film, most = _film_of(app.scene, chosen, session, playing)
    except BaseException:
        app.close()
        raise
    if hurry is not None:
        return lambda: _estimate(app, film, chosen, most, hurry, loaded)
    return lambda: _film(app, film, chosen, most)


def _film_of(scene, chosen, session, playing):
    """The Film that is asked for, and how many of its frames are.

    Args:
        playing: Makes a Player of a scene and a session.

    Raises:
        ValueError or OSError: A file doesn't allow it.
    """
    from ..viewer.document import TICKS_PER_SECOND
    from ..viewer.films import Film, clip_session, load_camera_path, with_timeline

    path = ()
    if chosen.camera is not None:
        seen_from = scene.field.world_to_model, scene.center, frame_size(chosen.size)
        path = load_camera_path(chosen.camera, *seen_from)
    begin, most = 0, chosen.frames
    if chosen.clip is not None:
        seconds = None if most is None else most / chosen.fps
        if most is None and path:
            seconds = path[-1].tick / TICKS_PER_SECOND
        elif most is None:
            seconds = chosen.turntable
        clip = scene.rigging, chosen.clip, chosen.softness, seconds
        session, begin, seconds = clip_session(*clip)
        most = most or max(round(seconds * chosen.fps), 1)  # the next one would be the first again
        scene.settings.show_bones = False
    if chosen.timeline:
        session, begin = with_timeline(playing(scene, session))
    film = Film(scene, session, chosen.fps, chosen.turntable, path, playing)
    if chosen.pose is not None:
        film.strike(chosen.pose)
    film.cut(begin + (chosen.first or 0), None if chosen.last is None else begin + chosen.last)
    if chosen.material is not None:
        scene.body.set_material(**asdict(MATERIALS[chosen.material]))
        scene.body.adapt_substeps()
    return film, most


def _options(chosen):
    from ..viewer.films import FilmOptions

    handles = chosen.show_handles or not (chosen.hide_handles or chosen.session is None)
    return FilmOptions(chosen.samples, chosen.shutter, chosen.transparent, handles, chosen.mode)


def _estimate(app, film, chosen, most, hurry, loaded):
    """Say how long the film takes, `loaded` seconds of it to load; returns the exit code."""
    from ..viewer.document import SessionError, spoken
    from ..viewer.films import render_seconds

    try:
        count = min(film.count, most or film.count)
        how = _options(chosen), hurry, chosen.output, chosen.codec, count
        seconds = loaded + render_seconds(app, film, *how)
    except SessionError as error:
        return complain(PROGRAM, str(error))
    finally:
        app.close()
    app.log("estimate", seconds=round(seconds, 1), frames=count)
    if not chosen.log_events:
        print(f"about {spoken(seconds)}, {count} frames")
    return 0


def _film(app, film, chosen, most):
    """Render all frames; returns the exit code."""
    from ..viewer.document import Patience, SessionError
    from ..viewer.films import FilmMaker

    options = _options(chosen)
    try:
        count = min(film.count, most or film.count)
        maker = FilmMaker(app, film, options)
        app.canvas.use(app.size)
        transparent = chosen.transparent
        app.recorder.start(chosen.output, False, chosen.codec, transparent)
        video = app.recorder.video
        patience = Patience("rendering", count)
        for frame in range(count):
            if not maker.make(frame):
                break
            app.log("frame", frame=frame, count=count)
            patience.heed(frame + 1)
        maker.finish()
        app.recorder.stop()
        if not app.recorder.failed:  # or why is the last line
            print(maker.report(video.encoding_seconds), file=sys.stderr)
    except SessionError as error:
        return complain(PROGRAM, str(error))
    finally:
        try:
            app.recorder.stop(cut_short=True)  # unless it was stopped above
        finally:
            app.close()
    return FAILED if app.recorder.failed else 0
