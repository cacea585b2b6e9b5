"""The state of a scene that edits change: kept before each edit, restored by undo and redo."""

from contextlib import contextmanager

import numpy as np


def state_of(scene) -> dict:
    """Positions, pins, material and surroundings."""
    solver = scene.solver
    return {
        "body": scene.body.state(),
        "viewpoint": scene.viewpoint.state(),
        "handles": scene.handles.state(),
        "timeline": scene.timeline.state(),
        "pinned": solver.pinned | scene.timeline.taken_pins,
        "vertices": solver.vertices.numpy().copy(),
        "velocities": solver.velocities.numpy().copy(),
        "asleep": solver.settled,
        "rest_lengths": solver.rest_lengths.astype(np.float32),
    }


def restore(scene, state: dict) -> None:
    """Return to a state; nothing is held afterwards."""
    solver = scene.solver
    scene.handles.release()
    scene.end_push()
    scene.timeline.restore(state["timeline"])
    scene.body.restore(state["body"])
    scene.viewpoint.restore(state["viewpoint"])
    solver.set_pinned(state["pinned"])
    scene.handles.restore(state["handles"])
    solver.set_state(state["vertices"], state["velocities"])
    if not np.array_equal(solver.rest_lengths.astype(np.float32), state["rest_lengths"]):
        solver.set_rest_lengths(state["rest_lengths"])  # edges have yielded since
    if state["asleep"]:  # awake, even a body at rest moves by roundings
        solver.fall_asleep()
    scene.revision += 1


def begin_anew(scene) -> None:
    """Return to the state of the first frame, without a past."""
    restore(scene, scene.first_state)
    scene.paused = False
    scene.solver.reset()  # it sleeps
    scene.journal.clear()


@contextmanager
def unless_it_fails(scene):
    """In the block, the scene is brought elsewhere; if that raises, it is as it was before."""
    journal = scene.journal
    state, floor, pins, paused = state_of(scene), scene.floor, scene.pins, scene.paused
    past = vars(journal) | {"events": list(journal.events), "steps": list(journal.steps)}
    try:
        yield
    except BaseException:
        restore(scene, state)
        scene.floor, scene.pins, scene.paused = floor, pins, paused
        vars(journal).update(past)
        raise
