"""A hand that makes a rig in a LiveViewer: joints, poses of bones, keys on the timeline."""

import time

import numpy as np

STRIP_LEFT, STRIP_RIGHT, STRIP_ABOVE = 80.0, 24.0, 98.0  # where ticks begin and end; the ruler
SHOWN = 300  # ticks on the strip, as long as no key is behind the fourth second


def key(viewer, name):
    viewer.tool("key", name)
    time.sleep(0.2)


def take(viewer, tool, name):
    """Take a tool into the hand by its key."""
    key(viewer, name)
    viewer.wait(lambda: viewer.state()["tool"] == tool, 20, f"the tool is {tool}")


def click(viewer, place):
    viewer.move(*place)
    viewer.tool("click", 1)
    time.sleep(0.3)


def place_joints(viewer, places):
    """Click on these places [points], each in turn; a joint that is there already is chosen."""
    for place in places:
        before = len(viewer.events("joint", "select_joint"))
        click(viewer, place)
        viewer.wait(
            lambda count=before: len(viewer.events("joint", "select_joint")) > count,
            20,
            f"there is a joint at {place}",
        )
    return viewer.next_state()["joints"]


def joint_at(viewer, bone, end="tail"):
    """Where a joint is [points], in a state that is reported from now on."""
    joints = viewer.next_state()["joints"]
    return next(np.array(j["at"]) for j in joints if (j["bone"], j["end"]) == (bone, end))


def drag_joint(viewer, bone, way):
    """Drag the tip of a bone by a way [points]; where it has come to."""
    viewer.drag(joint_at(viewer, bone), way, steps=6)
    return joint_at(viewer, bone)


def scrub(viewer, tick):
    """Put the playhead there; the panel is hidden.  Returns the tick."""
    width, height = viewer.state()["size"]
    x = STRIP_LEFT + (width - STRIP_LEFT - STRIP_RIGHT) * tick / SHOWN
    before = viewer.state()["playhead"]
    click(viewer, (x, height - STRIP_ABOVE))
    viewer.wait(lambda: viewer.state()["playhead"] != before, 20, "the playhead moves")
    return viewer.next_state()["playhead"]


def written(viewer, words, count):
    """Call the action that the search finds, which writes a file; its name."""
    viewer.find(words)
    viewer.wait(lambda: len(viewer.events("written")) >= count, 60, f"{words} has written a file")
    return viewer.events("written")[-1]["path"]
