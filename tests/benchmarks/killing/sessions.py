"""Sessions of a viewer in its window: saved by hand, and kept by the autosave meanwhile."""

import os
import signal

from fuzzing.models import small_models

from deformrf.core.field import load
from deformrf.viewer.document import left_behind, load_session
from deformrf.viewer.tools import MOVE, SCALE, TURN

from .kinds import Fault, Kind, Signals
from .process import Job, command

FRAMES, EVERY = 30, 8  # a session is saved in every so many frames
GESTURE = 5  # frames of a drag by the gizmo's keys
KINDS = MOVE, TURN, SCALE
COUNT = "kept"  # a file beside the sessions: how many edits the autosave had at least


def view(folder, *arguments):
    """deformrf view, with a hand that edits in each frame, and an autosave that is due in each."""
    os.environ["XDG_STATE_HOME"] = str(folder)
    from deformrf.commands import view as viewer
    from deformrf.viewer.document.sessions import autosave

    autosave.SECONDS, autosave.SHARE = 0.0, 1e9
    original, note = viewer._open, os.open(folder.parent / COUNT, os.O_WRONLY | os.O_CREAT, 0o644)

    def opened(*inputs):
        app = original(*inputs)
        frame = app.frame

        def edited(*inputs, **options):
            number = app.frame_count
            app.scene.body.set_material(damping=1.0 + number % 7)
            use_gizmo(app, number)
            frame(*inputs, **options)
            if app.autosave is not None and app.autosave.path.exists():
                os.pwrite(note, b"%8d" % len(app.scene.journal.events), 0)
            if number % EVERY == 0:
                path = folder / "session.jsonl"
                app.recorder.save_session(app.scene, app.session_start, path)

        app.frame = edited
        return app

    viewer._open = opened
    command("view", *arguments)


def use_gizmo(app, number):
    """A gesture of a few frames: points are selected, dragged by a number along an axis, let go."""
    controls, handles = app.controls, app.scene.handles
    gesture, turn = divmod(number, GESTURE)
    if turn == 0:
        handles.select(handles.control_ids[gesture % 3 :: 3])
        controls.turn_into(KINDS[gesture % 3])
        controls.along(gesture % 3)
    elif turn == GESTURE - 1:
        controls.finish()
    else:
        controls.type(str(turn % 10))


class Sessions(Kind):
    """What was saved is whole, and what was kept a moment ago is offered at the next start."""

    def prepare(self):
        self.model = next(small_models(self.inputs))
        self.field = load(self.model)

    def put(self, number):
        (self.folder / COUNT).unlink(missing_ok=True)

    def job(self):
        return Job((self.out, self.model, "--device", "cpu", "--frames", FRAMES), view)

    def look(self, ended):
        self.check_strays(ended, "session.jsonl", "deformrf")
        kept = self.out / "deformrf" / "sessions"
        found = left_behind(kept, self.field.mesh) if kept.exists() else None
        count = self.folder / COUNT
        count = int(count.read_bytes() or b"0") if count.exists() else 0
        saved = self.out / "session.jsonl"
        if saved.exists():
            load_session(saved, self.field)
        if found is None:
            if not ended.code:
                return "ended in order"
            if count:
                raise Fault(f"{count} edits are kept nowhere: {ended.said}")
            return "nothing done yet"
        events = load_session(found, self.field, whole=ended.number != signal.SIGKILL).events
        if len(events) < count:
            raise Fault(f"{len(events)} of {count} edits are kept")
        return "kept, saved" if saved.exists() else "kept"


class SessionSignals(Signals, Sessions):
    pass
