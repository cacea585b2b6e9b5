"""A rig that is made, bent, keyed and filmed by a hand in a real X window."""

import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
import rig_hand as hand
from PIL import Image
from xwindow import LiveViewer, missing_tools, screen

from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.core.field import load
from deformrf.wings.rig import rig_from

pytestmark = [pytest.mark.e2e, pytest.mark.gl]
JOINTS = (500, 560), (500, 460), (500, 200)  # points: the stand's foot, the neck, the goggles


@pytest.fixture
def viewer(tmp_path, give_up_window):
    if missing_tools():
        give_up_window(f"needs {' and '.join(missing_tools())}")
    (tmp_path / "screen").mkdir()
    with screen(tmp_path / "screen") as display:
        made = LiveViewer(display, DEFAULT_MODEL, tmp_path, "--size", "1000x700")
        yield made
        made.end()


def test_a_helmet_is_rigged_bent_keyed_and_filmed(viewer, tmp_path):
    viewer.move(600, 640)
    hand.key(viewer, "Tab")  # no panel in the way
    hand.take(viewer, "joints", "j")
    joints = hand.place_joints(viewer, JOINTS)
    assert [(j["bone"], j["end"]) for j in joints] == [(0, "tail"), (0, "head"), (1, "tail")]
    for joint, place in zip(joints, (JOINTS[1], JOINTS[0], JOINTS[2]), strict=True):
        assert joint["at"] == pytest.approx(place, abs=2.0)

    hand.take(viewer, "bones", "a")
    hand.key(viewer, "shift+a")
    hand.key(viewer, "shift+k")
    assert hand.scrub(viewer, 60) == pytest.approx(60, abs=1)
    tip = hand.joint_at(viewer, 1)
    assert hand.drag_joint(viewer, 1, (110, 50)) == pytest.approx(np.add(tip, [110, 50]), abs=3.0)
    assert viewer.state()["undoes"] == "pose a bone"
    assert viewer.state()["max_displacement"] > 0.1
    hand.key(viewer, "shift+k")
    hand.key(viewer, "Return")
    viewer.wait(lambda: viewer.state()["moving"], 10, "the timeline plays")
    viewer.wait(lambda: not viewer.state()["moving"], 30, "the timeline has ended")

    model = load(tmp_path / hand.written(viewer, "export model", 1))
    rig = rig_from(model.rig_arrays, model.mesh.vertex_count)
    assert rig.skeleton.parents.tolist() == [-1, 0]
    session = tmp_path / hand.written(viewer, "export session", 2)
    folder = tmp_path / "film"
    code = "import sys; from deformrf.commands.render import main; sys.exit(main())"
    shown = "--session", session, "--timeline", "--hide-handles", "--device", "cpu"
    size = "--size", "160x120", "--fps", "4", "-o", folder
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, (DEFAULT_MODEL, *shown, *size))],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    frames = [np.asarray(Image.open(path)).astype(int) for path in sorted(folder.iterdir())]
    assert len(frames) == 5
    steps = [(abs(b - a) > 24).any(axis=-1).mean() for a, b in pairwise(frames)]
    assert min(steps) > 0.005  # it bends all the way
