"""What a window shows of a training run: snapshots of its field, one in the place of the other.

A scene is made where the mesh is new, and again as the object becomes clear, because size, camera
and handles follow what can be seen.  A scene that the user has touched stays as it is, bent or
dragged, until the mesh changes.  One of another model stays for good.
"""

import logging
import math
import time
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyglet

from ...core import field as fields
from ...core.field import TetField
from ...core.render import Renderer
from ..document import Scene
from ..files import readable
from ..layers import choose_path
from ..loading import Progress, prepare
from ..showing import show
from .train_job import TrainJob

log = logging.getLogger(__name__)

SCENE_FACTOR = 2  # steps of the stage at a scene, over those at the scene before
SHOW_SHARE = 0.06  # of the time that pictures of new snapshots may take
LONGEST_REST = 3.0  # s; a picture that comes late because training is busy would cause a longer one
POLL_SECONDS = 0.05  # between two frames before there is a scene


@dataclass(frozen=True)
class Snapshot:
    """A field that is being trained, ready to be shown."""

    field: TetField
    renderer: Renderer
    scene: Scene | None  # of the field; None: the one before goes on
    same_mesh: bool  # as the snapshot before


class Watcher:
    """Shows training in an App: of the last TrainJob that began.

    Attributes:
        preparing: How far the preparation of the first snapshot is.
        over: Whether there is no run any more, and its model is shown.
    """

    over = True
    _coming: Future | None = None

    def __init__(self, app):
        self.app, self._pool = app, ThreadPoolExecutor(1, "snapshots")

    def begin(self, job: TrainJob) -> None:
        """Show a job from now on."""
        if self._coming is not None:  # of the run before, whose model nobody waits for
            wait([self._coming])
        self.app.train_job, self.job, self.preparing = job, job, Progress(job.device)
        self._path = choose_path(self.app.ctx, job.device, "auto")
        self._coming = None
        self._field, self._scene_step = None, 0  # of the last snapshot; of its stage, at a scene
        self._scene = self._home = None  # that was shown; the camera's first orbit around it
        self._shown_at = self._due = 0.0  # when a snapshot was, and when the next may be
        self._accumulates = True  # the user's setting
        self._watching, self._ends, self.over = True, False, False

    def follow(self) -> None:
        """Called in every frame: show a snapshot if there is one, and the model at the end."""
        if self.over:
            return
        if self._scene is not None and self.app.scene is not self._scene:  # another was opened
            self._leave()
        if self._watching:
            self._follow_snapshots()
        if self.job.ended and self._coming is None:
            self._end()

    def _follow_snapshots(self):
        now, job = time.perf_counter(), self.job
        if self._shown_at and self.app.radiance.settled:
            rest = (now - self._shown_at) * (1.0 / SHOW_SHARE - 1.0)
            self._due, self._shown_at = min(self._due, now + rest), 0.0
        if self._coming is None and job.snapshot and now >= self._due and not job.ended:
            told, job.snapshot = job.snapshot, None
            self._begin(Path(told["path"]), told["step"])
        if self._coming is not None and self._coming.done():
            self._take()

    def _begin(self, path, step):
        scene = self.app.scene
        kept = scene is not None and scene.journal.steps  # the user has done something to it
        self._coming = self._pool.submit(self._made, path, step, kept)
        if self.job.device != "cpu":  # or launches would get into graphs that frames record
            wait([self._coming])

    def _made(self, path, step, kept):
        """The Snapshot of a file, which is deleted; in a thread, if that may launch kernels."""
        field, before = fields.load(path), self._field
        if path != self.job.output:
            path.unlink()  # the run may write the next one
        same_mesh = before is not None and all(
            np.array_equal(getattr(before.mesh, name), getattr(field.mesh, name))
            for name in ("rest_vertices", "tets")
        )
        if same_mesh:
            field = replace(field, mesh=before.mesh)
        if same_mesh and (kept or step < SCENE_FACTOR * self._scene_step):
            return Snapshot(field, Renderer(field, self.job.device), None, True)
        name = self.job.output.stem
        scene, renderer = prepare(field, name, self.job.device, self.preparing)
        self._scene_step = step
        return Snapshot(field, renderer, scene, same_mesh)

    def _take(self):
        """Show the snapshot that was made; if there is none the run goes on without a view."""
        try:
            snapshot = self._coming.result()
        except FileNotFoundError:  # the run is over, and its folder gone
            self._coming = None
            return
        except Exception:
            self._coming = None
            self._leave()
            log.exception("The field can't be shown any more; training goes on.")
            return
        app, scene = self.app, self.app.scene
        if scene is not None and app.controls.mode and not snapshot.same_mesh:
            return  # what is dragged has the mesh before
        self._coming, self._field = None, snapshot.field
        self._shown_at = time.perf_counter()
        self._due = self._shown_at + LONGEST_REST
        if snapshot.scene is None or (snapshot.same_mesh and scene.journal.steps):
            scene.field = snapshot.field
            app.radiance.set_renderer(snapshot.renderer)
        elif self._scene is None and scene is not None and scene.journal.steps:
            self._watching = False
        else:
            self._show(snapshot)

    def _show(self, snapshot: Snapshot):
        """Show the snapshot's scene; the user's settings stay, and the camera if it was moved."""
        app, scene, home = self.app, snapshot.scene, snapshot.scene.orbit
        scene.field = snapshot.field
        if app.scene is None:
            scene.settings.show_box = True
            app.usual_fps = scene.settings.target_fps
        else:
            scene.settings = app.scene.settings
            if app.scene is self._scene and app.scene.orbit is not self._home:
                scene.orbit = app.scene.orbit
        if self._scene is None:
            self._accumulates, scene.settings.accumulate = scene.settings.accumulate, False
            app.loaded_on = app.loaded_on or (self.job.device, "auto")
            app.end()
            app.autosave = None
        show(app, scene, snapshot.renderer, self._path)
        self._scene, self._home = scene, home

    def _leave(self):
        """Watch the run no longer."""
        self._watching = False
        if self._scene is not None:
            self.app.scene.settings.accumulate = self._accumulates
            self._scene = None

    def _end(self):
        """The run is over: show its model, or open it if another one is shown."""
        app, job = self.app, self.job
        shows = self._watching and (self._scene is not None or app.scene is None)
        if shows and job.code == 0 and not self._ends:
            self._ends = True
            self._begin(job.output, math.inf)
            return
        self._leave()
        self.over = True
        if job.code == 0 and not shows:
            app.opening.asked = job.output
        elif shows and app.scene is not None:
            app.begin_autosave()
            if job.code == 0:
                app.scene.source = job.output
                app.preferences.opened(job.output)
        if not job.stays:  # else the terminal has it
            app.train_job = None
            app.recorder.say(readable(job.line))

    def begin_offered(self) -> None:
        """Do what the dialog offers."""
        app = self.app
        offer, app.questions.dialog = app.questions.dialog, None
        if app.train_job is None or app.train_job.ended:
            self.begin(TrainJob(offer.arguments, offer.output, str(app.scene.solver.device)))
            app.log("training", path=offer.data)
        else:
            app.recorder.say("one model is being trained: wait for it, or stop it")

    def watch(self, job: TrainJob) -> None:
        """Show a job, and then its model; returns when the window is closed."""
        app = self.app
        self.begin(job)
        while app.scene is None and not (app.window.has_exit or self.over):
            pyglet.clock.tick()
            app.show_alone(app.panels.training_window)
            self.follow()
            time.sleep(POLL_SECONDS)
        if app.scene is not None and not app.window.has_exit:
            app.run()
