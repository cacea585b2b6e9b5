"""A run without a window: frames go into files, while --drag moves a vertex.

It goes out in the first third of the frames, is held in the second, and then let go.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

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


def resolved(script: DragScript, scene) -> DragScript:
    """The drag of a vertex of this scene, with the vertex's id.

    Raises:
        ValueError: The scene has no such vertex, or it is pinned.
    """
    free = scene.handles.control_ids
    if script.vertex == TOP:
        if not len(free):
            raise ValueError("--drag names the top vertex, but every control vertex is pinned")
        heights = scene.handles.at(free)[:, 2]
        return replace(script, vertex=int(free[heights.argmax()]))
    if not scene.handles.exists(script.vertex):
        last = scene.field.mesh.vertex_count + len(scene.handles.points) - 1
        raise ValueError(f"--drag names vertex {script.vertex}; the model has 0 to {last}")
    if scene.solver.pinned[scene.handles.corners(script.vertex)].all():
        some = ", ".join(map(str, free[:5]))
        raise ValueError(
            f"--drag names vertex {script.vertex}, which is pinned; take one of {some}"
        )
    return script


def hold_ends(frame_count: int) -> int:
    """The first frame after the release."""
    return -(-2 * frame_count // 3)


def play(script: DragScript, scene, frame: int, frame_count: int) -> None:
    """Move the scene's grabbed vertex as in this frame; called before the scene advances."""
    if frame == 0:
        scene.handles.grab(script.vertex)
    if scene.handles.grabbed is None:
        return
    if frame >= hold_ends(frame_count):
        scene.handles.release()
        return
    out = min((frame + 1) / max(frame_count / 3.0, 1.0), 1.0)
    smooth = out * out * (3.0 - 2.0 * out)
    start = scene.handles.grabbed.start
    scene.handles.drag_to(start + smooth * np.array(script.offset))


def render_files(app, run, fps: int, drag: DragScript | None) -> None:
    """Render the frames of the command's RunArguments, one after another, each in full.

    The screenshot shows the last frame, or the last one before a drag is let go.
    """
    count = run.frames or FRAME_COUNT
    shot = count - 1 if drag is None else hold_ends(count) - 1
    app.canvas.use(app.size)
    if run.record is not None:
        app.recorder.start(run.record, live=False)
    for frame in _shown(count):
        if drag is not None:
            play(drag, app.scene, frame, count)
        if run.screenshot is not None and frame == shot:
            app.recorder.screenshot(run.screenshot)
        app.window.switch_to()
        app.frame(1.0 / fps, whole=True)
    app.recorder.stop()


def _shown(count: int):
    """The numbers of the frames, under a progress bar on stderr if that is a terminal."""
    if count == 1:
        return range(1)
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    return track(range(count), "rendering", console=console, disable=not console.is_terminal)
