"""A training run in a thread of its own, and the snapshots of its field that a window shows.

The run pauses every few steps.  There it exports its field and makes a renderer of it, as often
as a small share of its time allows.  It makes a scene where the mesh is new, and again as the
object becomes clear, because size, camera and handles follow what can be seen.  The window takes
what is made; a scene that the user has touched stays as it is, bent or dragged, until the mesh
changes.

Ctrl-C and "Stop and save" raise KeyboardInterrupt in the run's thread at its next pause, which
ends the run as Ctrl-C does without a window; Ctrl-C again raises it at once.
"""

import ctypes
import logging
import threading
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, replace

from ...core.field import TetField
from ...core.render import Renderer
from ...core.training import Pause, Trained
from ..document import Scene
from ..loading import Progress, prepare

log = logging.getLogger(__name__)

SECONDS, MOST_SECONDS = 1.0, 10.0  # from one snapshot to the next
AGE_SHARE = 0.03  # of the run's age, as a run of minutes changes little within a second
COST_SHARE = 0.03  # of the run's time, that making snapshots may take
SCENE_FACTOR = 2  # steps of the stage at a scene, over those at the scene before
POLL_SECONDS = 0.05  # between two looks of a run that waits


@dataclass(frozen=True)
class Snapshot:
    """A field that is being trained, ready to be shown."""

    field: TetField
    renderer: Renderer
    scene: Scene | None  # of the field; None: the one before goes on
    same_mesh: bool  # as the snapshot before


class Gate:
    """Who may use the device: the run, or, while the run pauses, the window.

    On CUDA, launches of two threads would meet on one stream, and one thread's would land in
    the graph that the other records.  On the CPU the gate is always open.
    """

    def __init__(self, always_open: bool):
        self._changed = threading.Condition()
        self._always = self._open = always_open
        self._wanted = self._inside = False

    def pass_through(self, seconds: float = 0.0) -> None:
        """In the run: let the window in once if it wants to come in, or comes within so long."""
        if self._always:
            time.sleep(seconds)
            return
        with self._changed:
            if self._wanted or seconds:
                self._open = True
                self._changed.notify_all()
                left = self._changed.wait_for(lambda: not self._open, seconds or None)
                if not left:
                    self._changed.wait_for(lambda: not self._inside)
                    self._open = False

    @contextmanager
    def entered(self, seconds: float):
        """In the window: context that has the device; gives whether it came in that soon."""
        with self._changed:
            self._wanted = True
            self._inside = self._changed.wait_for(lambda: self._open, seconds)
            self._wanted = False
        try:
            yield self._inside
        finally:
            with self._changed:
                if self._inside:
                    self._inside, self._open = False, self._always
                    self._changed.notify_all()

    def open(self) -> None:
        """Leave it open from now on: the run is over."""
        with self._changed:
            self._always = self._open = True
            self._changed.notify_all()


class LiveRun:
    """A run, as its own thread and the window's see it.

    Attributes:
        last: The last Pause: how far the run is, and its curve.  None before it.
        preparing: How far the preparation of the first snapshot is.
        paused: Whether the run is to wait; the window decides.
        waiting: Whether it waits.
        watched: Whether a window shows the run; else no snapshots are made.
        stopping: Whether the run was told to stop.
        touched: Whether the user has done something to the scene; the window tells.
        trained: Whether all that is left is to write and score the model.
        ended: Whether it is over, with the model written or an error.
        steps_per_second: Of late; 0 before it is known.
    """

    def __init__(self, name: str, device: str, clock: Callable[[], float] = time.perf_counter):
        """Take the name of the data, and the Warp device of the run."""
        self.name, self.device = name, device
        self.gate = Gate(device == "cpu")
        self.last: Pause | None = None
        self.preparing = Progress(device)
        self.paused, self.watched, self.touched = False, True, False
        self.waiting, self.stopping, self.trained, self.ended = False, False, False, False
        self.steps_per_second = 0.0
        self._clock = clock
        self._mesh, self._scene_step = None, 0  # of the last snapshot; of its stage, at a scene
        self._snapshot, self._lock = None, threading.Lock()
        self._due = 0.0  # when the next snapshot may be made
        self._paused_at = 0.0  # when the last pause ended
        self._thread, self._code, self._error = None, None, None

    # -- in the run's thread -------------------------------------------------------------

    def on_pause(self, pause: Pause) -> None:
        """Called every few steps; raises KeyboardInterrupt to stop."""
        now, before = self._clock(), self.last
        if before is not None and before.stage == pause.stage:
            self.steps_per_second = (pause.step - before.step) / max(now - self._paused_at, 1e-9)
        self.last = pause
        if self.watched and self._snapshot is None and now >= self._due:
            self._offer(pause.export, pause.seconds, pause.step)
        self.gate.pass_through()
        while self.paused and self.watched and not self.stopping:
            self.waiting = True
            self.gate.pass_through(POLL_SECONDS)
        self.waiting = False
        if self.stopping:
            raise KeyboardInterrupt
        self._paused_at = self._clock()

    def on_trained(self, trained: Trained) -> None:
        """Called with the result, before it is written."""
        self.paused, self.trained = False, True
        if self.watched:
            self._offer(lambda: trained.field)

    def _offer(self, export, age=0.0, step=None):
        """Make a snapshot; if that fails the run goes on without a view."""
        begin = self._clock()
        try:
            field = export()
            same_mesh = field.mesh is self._mesh
            known = step is not None and step < SCENE_FACTOR * self._scene_step
            if same_mesh and (self.touched or known):
                scene, renderer = None, Renderer(field, self.device)
            else:
                scene, renderer = prepare(field, self.name, self.device, self.preparing)
                self._scene_step = step or 0
            snapshot = Snapshot(field, renderer, scene, same_mesh)
        except Exception:
            self.watched = False
            log.exception("The field can't be shown any more; training goes on.")
            return
        self._mesh = field.mesh
        with self._lock:
            missed = self._snapshot
            if missed is not None and same_mesh:  # the mesh is still new to the window
                scene = scene or missed.scene
                snapshot = replace(snapshot, scene=scene, same_mesh=missed.same_mesh)
            self._snapshot = snapshot
        end = self._clock()
        cost = 0.0 if snapshot.scene else (end - begin) / COST_SHARE  # a stage has few scenes
        self._due = end + max(SECONDS, min(AGE_SHARE * age, MOST_SECONDS), cost)

    def _work(self, job):
        try:
            self._code = job()
        except BaseException as error:  # `result` raises it
            self._error = error
        finally:
            self.ended = True
            self.gate.open()

    # -- in the window's thread ----------------------------------------------------------

    def start(self, job: Callable[[], int]) -> None:
        """Begin the run, whose job calls `on_pause` and `on_trained`."""
        self._thread = threading.Thread(target=self._work, args=(job,), name="training")
        self._thread.start()

    @property
    def failed(self) -> bool:
        """Whether the run ended with an error."""
        return self._error is not None

    def peek(self) -> Snapshot | None:
        """The snapshot that was not taken yet, if there is one."""
        return self._snapshot

    def take(self) -> Snapshot | None:
        """The same, which is taken now."""
        with self._lock:
            snapshot, self._snapshot = self._snapshot, None
        return snapshot

    def stop(self) -> None:
        """End the run after its next few steps, and keep the work; a second time, at once.

        An exception that comes at once may come where Python can only report and ignore it.
        """
        at_once, self.stopping = self.stopping or self.trained, True
        if at_once and self._thread is not None and self._thread.is_alive():
            thread = ctypes.c_ulong(self._thread.ident)
            ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, ctypes.py_object(KeyboardInterrupt))

    def result(self) -> int:
        """Wait for the run without a view; returns its exit code, or raises its error."""
        self.watched = False
        while self._thread is not None and self._thread.is_alive():
            try:
                self._thread.join(POLL_SECONDS)
            except KeyboardInterrupt:
                self.stop()
        if self._error is not None:
            raise self._error
        return self._code
