"""Isolate in a real X window: a click, undo and redo of it, a cut, and what is saved."""

from dataclasses import replace

import numpy as np
import pytest
from xwindow import LiveViewer, missing_tools, screen

from deformrf.core import field as fields
from deformrf.core.field import pack_mask, subtet_middles, unpack_mask

pytestmark = [pytest.mark.e2e, pytest.mark.gl]


@pytest.fixture
def halves(ball):
    """The ball with a slit, wide open in the view from the front."""
    away = abs(subtet_middles(ball.mesh)[..., 0] - 0.5) > 0.04
    return replace(ball, occupancy=pack_mask(unpack_mask(ball.occupancy) & away))


@pytest.fixture
def viewer(give_up_window, halves, tmp_path):
    if missing_tools():
        give_up_window(f"needs {' and '.join(missing_tools())}")
    fields.save(halves, tmp_path / "halves.npz")
    with screen(tmp_path) as display:
        made = LiveViewer(display, tmp_path / "halves.npz", tmp_path, "--size", "1000x700")
        yield made
        made.end()


def test_a_click_its_undo_and_redo_and_a_cut(viewer, halves):
    def previews():
        return [entry["strokes"] for entry in viewer.events("isolated")]

    viewer.tool("key", "1")  # from the front
    viewer.find("isolate one thing")
    viewer.wait(lambda: previews() == [0], 60, "the model was looked at")
    at = np.array([entry["at"] for entry in viewer.state()["vertices"]])
    at = at[at[:, 0] < 680]
    middle = at.mean(axis=0)
    viewer.click(middle[0] - 60, middle[1])
    viewer.wait(lambda: previews() == [0, 1], 60, "the click is worked out")
    viewer.tool("key", "ctrl+z")
    viewer.wait(lambda: previews() == [0, 1, 0], 60, "the stroke is taken back")
    viewer.tool("key", "ctrl+shift+z")
    viewer.wait(lambda: previews() == [0, 1, 0, 1], 60, "it is back again")
    assert viewer.next_state()["undoes"] == "" and not viewer.events("delete")
    viewer.tool("key", "Return")
    viewer.wait(lambda: viewer.last("delete"), 20, "the rest is cut off")
    viewer.wait(lambda: viewer.state()["undoes"] == "delete", 20, "that is a step")
    assert viewer.state()["tool"] == "grab"

    viewer.find("export model")
    path = viewer.wait(lambda: viewer.last("written"), 20, "the model is written")["path"]
    saved = fields.load(path)
    x = subtet_middles(saved.mesh)[unpack_mask(saved.occupancy)][:, 0]
    assert len(x) > 1000 and (x < 0.5).all()
    viewer.tool("key", "ctrl+z")
    viewer.wait(lambda: viewer.state()["undoes"] == "", 20, "it is undone")
