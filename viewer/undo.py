"""The state of a scene that edits change: kept before each edit, restored by undo and redo."""

import math


def state_of(scene) -> dict:
    """Positions, pins, material and surroundings."""
    solver = scene.solver
    yields = math.isfinite(scene.body.material.yield_strain)
    return {
        "body": scene.body.state(),
        "pinned": solver.pinned.copy(),
        "patches": scene.patches.copy(),
        "vertices": solver.vertices.numpy().copy(),
        "velocities": solver.velocities.numpy().copy(),
        "rest_lengths": solver.rest_lengths if yields else None,
    }


def restore(scene, state: dict) -> None:
    """Return to a state; nothing is held afterwards."""
    solver = scene.solver
    scene.release()
    scene.end_push()
    scene.body.restore(state["body"])
    solver.set_pinned(state["pinned"])
    scene.patches = state["patches"].copy()
    solver.set_state(state["vertices"], state["velocities"])
    if state["rest_lengths"] is not None:
        solver.set_rest_lengths(state["rest_lengths"])
    scene.hover = None
    scene.revision += 1
