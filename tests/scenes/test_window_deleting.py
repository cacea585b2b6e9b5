"""Deleting with the brush in a real X window: seen, undone, saved as a smaller model."""

import numpy as np
import pytest
from xwindow import LiveViewer, missing_tools, screen

from deformrf.core import field as fields

pytestmark = [pytest.mark.e2e, pytest.mark.gl]


@pytest.fixture
def viewer(give_up_window, ball_file, tmp_path):
    if missing_tools():
        give_up_window(f"needs {' and '.join(missing_tools())}")
    with screen(tmp_path) as display:
        made = LiveViewer(display, ball_file, tmp_path, "--size", "1000x700")
        yield made
        made.end()


def test_a_stroke_deletes_and_is_undone_and_the_rest_is_saved(viewer, ball):
    at = np.array([entry["at"] for entry in viewer.state()["vertices"]])
    at = at[(at[:, 0] > 80) & (at[:, 0] < 680)]
    middle = at.mean(axis=0)
    count = len(viewer.state()["vertices"])
    before = viewer.pixels()
    viewer.tool("key", "d")
    viewer.move(*middle)
    for _ in range(9):  # the brush is larger than a tet
        viewer.tool("click", 4)
    viewer.tool("keydown", "shift")
    viewer.drag(middle - (60, 0), (120, 0))
    viewer.tool("keyup", "shift")
    left = viewer.wait(lambda: viewer.last("delete"), 20, "a stroke is reported")["left"]
    assert left < ball.mesh.tet_count
    viewer.wait(lambda: viewer.state()["undoes"] == "delete", 20, "it can be undone")
    state = viewer.next_state()
    assert len(state["vertices"]) < count
    spot = slice(*(middle[1] + (-8, 8)).astype(int)), slice(*(middle[0] + (-8, 8)).astype(int))
    assert abs(viewer.pixels()[spot].astype(int) - before[spot]).mean() > 20.0

    viewer.find("export model")
    path = viewer.wait(lambda: viewer.last("written"), 20, "the model is written")["path"]
    assert fields.load(path).mesh.tet_count == left

    viewer.tool("key", "ctrl+z")
    viewer.wait(lambda: viewer.state()["undoes"] == "", 20, "it is undone")
    viewer.wait(lambda: len(viewer.state()["vertices"]) == count, 20, "all points are back")
    viewer.tool("key", "Escape", "ctrl+q")
    assert viewer.process.wait(20) == 0
