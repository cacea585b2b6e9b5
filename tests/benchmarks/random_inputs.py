"""Random keys, clicks and drags in the viewer: none raises, memory stays, sessions play again.

    python tests/benchmarks/random_inputs.py [--inputs 100000] [--seed N] [--model fox.npz]

The window has no display.  The hand (tests/support/random_hands.py) selects points, takes the
gizmo, bones and joints, begins drags without a button, types numbers, and changes between the
keys of deformrf and Blender.  The panel shows in every second session.  After every SESSION
inputs the session is saved and played again from its file, to the bit, and a new one begins.
Prints a line for each, with the memory that the process holds; exits with 1 after a fault.
"""

import argparse
import os
import secrets
import sys
import tempfile
from pathlib import Path

import numpy as np
from random_hands import Inputs

from deformrf.core.base.paths import BUNDLED
from deformrf.core.field import load
from deformrf.viewer.document import (
    Player,
    Scene,
    load_session,
    save_session,
    start_of,
)
from deformrf.viewer.events import EventLog
from deformrf.viewer.memory import resident_bytes
from deformrf.viewer.window import open_window

SESSION = 2000  # inputs
SIZE = 640, 480


def played_again(app, field, folder) -> bool:
    """Whether the session of what was done ends in the same pose, to the bit."""
    path = save_session(app.scene, app.session_start, folder / "session.jsonl")
    session, other = load_session(path, field), Scene(field, "again", "cpu")
    Player(other, session).play_to(session.ticks)
    return np.array_equal(other.solver.vertices.numpy(), app.scene.solver.vertices.numpy())


def use(app, random, count) -> None:
    """So many inputs, and a frame after each: ImGui would fall behind, which has its own queue."""
    hand = Inputs(app, random)
    for _ in range(count):
        hand.act()
        app.frame(float(random.uniform(0.0, 0.03)))
        if app.gui._failed:
            raise RuntimeError(f"a panel failed: {app.gui._failed}")
    app.controls.cancel()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--model", type=Path, default=BUNDLED["fox"])
    arguments = parser.parse_args()
    seed = secrets.randbits(32) if arguments.seed is None else arguments.seed
    field, faults = load(arguments.model), 0
    window = open_window(SIZE, headless=True)
    from deformrf.viewer.app import App

    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_STATE_HOME"] = folder
        app = App(*window, EventLog(False))
        app.load(field, "model", "cpu")
        for number in range(-(-arguments.inputs // SESSION)):
            settings = app.scene.settings
            settings.show_panel = number % 2 == 0  # where the hand may begin to type
            settings.fixed_resolution = 0.25 if number % 4 > 1 else None  # faster; or upsampled
            use(app, np.random.default_rng([seed, number]), SESSION)
            same = played_again(app, field, Path(folder))
            faults += not same
            memory = resident_bytes() / 2**20
            end = "the same again" if same else "ANOTHER POSE"
            edits = len(app.scene.journal.events)
            line = f"session {number} of seed {seed}: {edits} edits, {end}, {memory:.0f} MB"
            print(line, flush=True)
            app.autosave.end()
            app.scene.states.begin_anew()
            app.session_start = start_of(app.scene)
            app.begin_autosave()
        app.close()
    sys.exit(int(faults > 0))


if __name__ == "__main__":
    main()
