"""The drag of --drag: out in the first third of the frames, held in the second, then let go."""

import math
from dataclasses import dataclass, replace

import numpy as np

TOP = "top"  # in place of an id
LONGEST_OFFSET = 2.0  # model units; farther away, the vertex leaves the picture


@dataclass(frozen=True)
class DragScript:
    """The drag of --drag."""

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
    free = scene.control_ids[~scene.solver.pinned[scene.control_ids]]
    if script.vertex == TOP:
        if not len(free):
            raise ValueError("--drag names the top vertex, but every control vertex is pinned")
        heights = scene.field.mesh.rest_vertices[free, 2]
        return replace(script, vertex=int(free[heights.argmax()]))
    count = scene.field.mesh.vertex_count
    if not 0 <= script.vertex < count:
        raise ValueError(f"--drag names vertex {script.vertex}; the model has 0 to {count - 1}")
    if scene.solver.pinned[script.vertex]:
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
        scene.grab(script.vertex)
    if scene.grabbed is None:
        return
    if frame >= hold_ends(frame_count):
        scene.release()
        return
    out = min((frame + 1) / max(frame_count / 3.0, 1.0), 1.0)
    smooth = out * out * (3.0 - 2.0 * out)
    start = scene.grabbed.before[0][script.vertex]
    scene.drag_to(start + smooth * np.array(script.offset))
