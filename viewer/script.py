"""A run without a window: frames go into files, while --drag moves a vertex.

It goes out in the first third of the frames, is held in the second, and then let go.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .document import EASINGS, Handles

FRAME_COUNT = 90  # by default
TOP = "top"  # in place of an id
LONGEST_OFFSET = 2.0  # model units; farther away, the vertex leaves the picture


@dataclass(frozen=True)
class DragScript:
    vertex: int | str  # an id, or TOP until `resolved` has put an id there
    offset: tuple[float, float, float]  # from where the vertex is, model units


def parse_drag(text: str) -> DragScript:
    """ "12:0.1,0,0" -> vertex 12 by (0.1, 0, 0); "top:0.1,0,0" -> the top one.

    Raises:
        ValueError: It is written in another way, or goes too far.
    """
    vertex, _, offset = text.partition(":")
    try:
        x, y, z = map(float, offset.split(","))
        script = DragScript(TOP if vertex == TOP else int(vertex), (x, y, z))
        length = math.hypot(x, y, z)
    except ValueError:
        length = math.nan
    if math.isnan(length):
        raise ValueError(
            f"--drag is '{text}'; write VERTEX:DX,DY,DZ, as in 12:0.1,0,0 or top:0.1,0,0"
        )
    if length > LONGEST_OFFSET:
        raise ValueError(
            f"--drag goes {length:.3g} model units far; {LONGEST_OFFSET:g} are the most "
            "(the object is about 1 wide)"
        )
    return script


def resolved(script: DragScript, handles: Handles) -> DragScript:
    """The drag of one of these handles, with its id.

    Raises:
        ValueError: There is no such vertex, or it is pinned.
    """
    free = handles.control_ids
    if script.vertex == TOP:
        if not len(free):
            raise ValueError("--drag names the top vertex, but every control vertex is pinned")
        return replace(script, vertex=int(free[handles.at(free)[:, 2].argmax()]))
    if not handles.exists(script.vertex):
        last = len(handles.patches) + len(handles.points) - 1
        raise ValueError(f"--drag names vertex {script.vertex}; the model has 0 to {last}")
    if handles.is_pinned(script.vertex):
        some = ", ".join(map(str, free[:5]))
        raise ValueError(
            f"--drag names vertex {script.vertex}, which is pinned; take one of {some}"
        )
    return script


def hold_ends(frame_count: int) -> int:
    """The first frame after the release."""
    return -(-2 * frame_count // 3)


def play(script: DragScript, handles: Handles, frame: int, frame_count: int) -> None:
    """Move the grabbed handle as in this frame; called before time passes in it."""
    if frame == 0:
        handles.grab(script.vertex)
    if handles.grabbed is None:
        return
    if frame >= hold_ends(frame_count):
        handles.release()
        return
    out = min((frame + 1) / max(frame_count / 3.0, 1.0), 1.0)
    smooth = EASINGS["smooth"](out)
    handles.drag_to(handles.grabbed.start + smooth * np.array(script.offset))


def render_files(run, drag: DragScript | None, handles: Handles, recorder, draw: Callable) -> None:
    """Render the frames of the command's RunArguments, one after another, each in full.

    The screenshot shows the last frame, or the last one before a drag is let go.  A progress bar
    is on stderr if that is a terminal.

    Args:
        handles: That are dragged.
        recorder: Of a canvas that has its size.
        draw: Lets the time of a frame pass, and draws it.
    """
    from rich.console import Console
    from rich.progress import track

    count, console = run.frames or FRAME_COUNT, Console(stderr=True)
    shot = count - 1 if drag is None else hold_ends(count) - 1
    silent = count == 1 or not console.is_terminal
    if run.record is not None:
        recorder.start(run.record, live=False)
    for frame in track(range(count), "rendering", console=console, disable=silent):
        if drag is not None:
            play(drag, handles, frame, count)
        if run.screenshot is not None and frame == shot:
            recorder.screenshot(run.screenshot)
        draw()
    recorder.stop()
