"""A hand that makes a rig in a LiveViewer: joints, poses of bones, keys on the timeline."""

import numpy as np

PADDING, NAMES, KEY = 10.0, 70.0, 7.0  # points: of the strip, of its tracks' names, of a key
RULER = 22.0  # points from the middle of the tracks up to the ruler
SHOWN = 300  # ticks on the strip, as long as no key is behind the fourth second


def key(viewer, name):
    viewer.tool("key", name)
    viewer.rest(0.2)


def take(viewer, tool, name):
    """Take a tool into the hand by its key."""
    key(viewer, name)
    viewer.wait(lambda: viewer.state()["tool"] == tool, 20, f"the tool is {tool}")


def click(viewer, place):
    viewer.move(*place)
    viewer.tool("click", 1)
    viewer.rest(0.3)


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
    """Put the playhead there; returns the tick."""
    x, y = viewer.place("tracks")
    right = viewer.state()["size"][0] - PADDING
    left = 2.0 * x - right + NAMES
    before = viewer.state()["playhead"]
    click(viewer, (left + (right - 2.0 * KEY - left) * tick / SHOWN, y - RULER))
    viewer.wait(lambda: viewer.state()["playhead"] != before, 20, "the playhead moves")
    return viewer.next_state()["playhead"]


def written(viewer, words, count):
    """Call the action that the search finds, which writes a file; its name."""
    viewer.find(words)
    viewer.wait(lambda: len(viewer.events("written")) >= count, 60, f"{words} has written a file")
    return viewer.events("written")[-1]["path"]
