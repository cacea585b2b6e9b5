"""Projects of a viewer in its window: saved again and again, and kept by the autosave meanwhile."""

import os
import signal

from deformrf.viewer.document import left_behind, load_project, load_session

from .kinds import Fault, Signals
from .process import Job, command
from .sessions import COUNT, EVERY, FRAMES, Sessions, use_gizmo

NAME = "object.deformrf"


def view(folder, *arguments):
    """deformrf view, with a hand that edits in each frame and saves a project in some."""
    os.environ["XDG_STATE_HOME"] = str(folder)
    from deformrf.commands import view as viewer
    from deformrf.viewer.document.sessions import autosave

    autosave.SECONDS, autosave.SHARE = 0.0, 1e9
    original, note = viewer._open, os.open(folder.parent / COUNT, os.O_WRONLY | os.O_CREAT, 0o644)

    def opened(*inputs):
        app = original(*inputs)
        frame = app.frame

        def count(is_kept):
            if is_kept:
                os.pwrite(note, b"%8d" % len(app.scene.journal.events), 0)

        def edited(*inputs, **options):
            number = app.frame_count
            app.scene.body.set_material(damping=1.0 + number % 7)
            use_gizmo(app, number)
            frame(*inputs, **options)
            count(app.autosave is not None and app.autosave.path.exists())
            if number % EVERY == EVERY // 2:  # also between gestures
                count(not app.save_project(folder / NAME))

        app.frame = edited
        return app

    viewer._open = opened
    command("view", *arguments)


class Projects(Sessions):
    """The file is an older project or a newer one, whole; what it lacks is kept."""

    def job(self):
        return Job((self.out, self.model, "--device", "cpu", "--frames", FRAMES), view)

    def look(self, ended):
        self.check_strays(ended, NAME, "deformrf")
        path, kept = self.out / NAME, self.out / "deformrf" / "sessions"
        count = self.folder / COUNT
        count = int(count.read_bytes() or b"0") if count.exists() else 0
        found = left_behind(kept, self.field.mesh) if kept.exists() else None
        edits = {}
        if path.exists():
            edits["saved"] = len(load_project(path).session.events)
        if found is not None:
            session = load_session(found, self.field, whole=ended.number != signal.SIGKILL)
            edits["kept"] = len(session.events)
        if max(edits.values(), default=0) < count:
            raise Fault(f"{count} edits were saved or kept, and there are {edits}")
        return " and ".join(edits) or "nothing done yet"


class ProjectSignals(Signals, Projects):
    pass
