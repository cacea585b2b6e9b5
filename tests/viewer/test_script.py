"""--drag: what can be written, and what it does."""

import re

import numpy as np
import pytest

from deformrf.core.base.paths import ROOT
from deformrf.viewer import script
from deformrf.viewer.document import Scene


def test_a_drag_is_a_vertex_and_an_offset():
    assert script.parse_drag("12:0.1,-1,.5") == script.DragScript(12, (0.1, -1.0, 0.5))
    assert script.parse_drag("top:0,0,1") == script.DragScript(script.TOP, (0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    "text", ["", "12", "12:1,2", "12:1,2,3,4", "a:1,2,3", "1:x,0,0", "1:nan,0,0"]
)
def test_anything_else_is_refused_with_an_example(text):
    with pytest.raises(ValueError, match="VERTEX:DX,DY,DZ"):
        script.parse_drag(text)


def test_an_offset_that_leaves_the_picture_is_refused():
    assert script.parse_drag("12:0,0,-2").offset == (0.0, 0.0, -2.0)
    for text in ("1492:1e9,0,0", "top:1.5,1.5,0", "1:1e300,1e300,0"):
        with pytest.raises(ValueError, match="2 are the most"):
            script.parse_drag(text)


def test_unknown_and_pinned_vertices_are_refused(ball):
    scene = Scene(ball, "ball", "cpu")
    count = len(scene.handles.points)
    with pytest.raises(ValueError, match=f"the model has 0 to {132 + count - 1}"):
        script.resolved(script.DragScript(132 + count, (0, 0, 0)), scene.handles)
    pin = int(scene.pins.nonzero()[0][0])
    with pytest.raises(ValueError, match="pinned"):
        script.resolved(script.DragScript(pin, (0, 0, 0)), scene.handles)


def test_an_id_stays_what_it_is(ball):
    scene = Scene(ball, "ball", "cpu")
    drag = script.DragScript(int(scene.handles.control_ids[2]), (0.1, 0.0, 0.0))
    assert script.resolved(drag, scene.handles) == drag


def test_the_top_is_the_highest_control_vertex_that_is_free(ball):
    scene = Scene(ball, "ball", "cpu")
    heights = scene.handles.at(scene.handles.control_ids)[:, 2]
    order = scene.handles.control_ids[np.argsort(-heights, kind="stable")]
    drag = script.DragScript(script.TOP, (0.1, 0.0, 0.0))
    assert script.resolved(drag, scene.handles).vertex == order[0]
    pinned = scene.solver.pinned.copy()
    pinned[scene.handles.corners(order[0])] = True
    scene.solver.set_pinned(pinned)
    assert script.resolved(drag, scene.handles).vertex == order[1]
    scene.solver.set_pinned(np.ones_like(pinned))
    with pytest.raises(ValueError, match="every control vertex is pinned"):
        script.resolved(drag, scene.handles)


def test_the_makefiles_drag_bends_the_bundled_model_whatever_its_vertices_are_called():
    from deformrf.core.base.paths import DEFAULT_MODEL
    from deformrf.core.field import modelfile
    from deformrf.core.render import Renderer
    from deformrf.viewer.document import visible_points

    text = re.search(r"^DEMO_DRAG \?= (.+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)[1]
    assert text.startswith("top:")
    field = modelfile.load(DEFAULT_MODEL)
    rest = field.mesh.rest_vertices
    renderer = Renderer(field)
    renderer.set_vertices(rest)
    scene = Scene(field, "helmet", "cpu", visible_points(renderer, rest)[0])
    drag = script.resolved(script.parse_drag(text), scene.handles)
    assert drag.vertex in scene.handles.control_ids
    assert not scene.pins[scene.handles.corners(drag.vertex)].any()
    height = scene.handles.at([drag.vertex], rest)[0, 2]
    assert height == scene.handles.at(scene.handles.control_ids, rest)[:, 2].max()
    for frame in range(script.hold_ends(30)):
        script.play(drag, scene.handles, frame, 30)
        scene.clock.advance(1 / 30)
    (moved,) = scene.handles.at([drag.vertex]) - scene.handles.at([drag.vertex], rest)
    assert moved == pytest.approx(drag.offset, abs=1e-5)


def test_the_vertex_goes_out_is_held_and_comes_back(ball):
    scene = Scene(ball, "ball", "cpu")
    vertex = int(scene.handles.control_ids[0])
    drag = script.DragScript(vertex, (0.1, 0.0, 0.0))
    distances = []
    for frame in range(40):
        script.play(drag, scene.handles, frame, 30)
        scene.clock.advance(1 / 30)
        rest = scene.field.mesh.rest_vertices
        (moved,) = scene.handles.at([vertex]) - scene.handles.at([vertex], rest)
        distances.append(float(moved[0]))
    assert distances[:10] == sorted(distances[:10])
    assert distances[9:20] == pytest.approx([0.1] * 11, abs=1e-5)
    assert scene.handles.grabbed is None
    assert min(distances[20:]) < 0.05


@pytest.mark.parametrize("count", [1, 2, 3, 7, 90])
def test_it_ends_let_go_or_held_but_never_fails(ball, count):
    scene = Scene(ball, "ball", "cpu")
    drag = script.DragScript(int(scene.handles.control_ids[0]), (0.1, 0.0, 0.0))
    for frame in range(count):
        script.play(drag, scene.handles, frame, count)
        scene.clock.advance(1 / 30)
    assert (scene.handles.grabbed is None) == (count > 2)
