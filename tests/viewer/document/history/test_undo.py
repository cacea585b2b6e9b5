"""The state of a scene that undo, and a session that can't be played, return to."""

from dataclasses import replace

import pytest

from deformrf.viewer.document import Scene


def test_what_fails_leaves_the_view_as_it_was(ball):
    """The camera and the way to show the object, which are no edits."""
    scene = Scene(ball, "ball", "cpu")
    orbit, shown = scene.orbit, vars(scene.settings).copy()
    with pytest.raises(ValueError, match="it is so"), scene.states.unless_it_fails():
        scene.orbit = replace(orbit, yaw=orbit.yaw + 1.0)
        scene.settings.background = (0.0, 0.0, 0.0)
        scene.settings.mesh_surface = "strain"
        scene.set_ground(True)
        raise ValueError("it is so")
    assert scene.orbit == orbit and vars(scene.settings) == shown and not scene.on_ground
