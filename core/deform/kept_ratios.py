"""Ratios of thin parts (sheets.py): fitted when something needs them first, then kept on the disk.

A fit takes seconds, and its result depends on nothing but the mesh and the program.  A file is
named by the SHA-256 of both.  It holds the SHA-256 of the ratios, then the ratios, in float64.
Where no file can be written, each process fits again.
"""

import atexit
import ctypes
import hashlib
import logging
import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Lock, Thread

import numpy as np
from platformdirs import user_cache_path
from threadpoolctl import threadpool_limits

from ..base.paths import whole_file
from . import sheets

ROOMS = Path(__file__).parent, Path(__file__).parents[1] / "geometry"  # what a fit depends on
MANY_TETS = 1000  # are fitted in a second or more, if they are thin
LEAST_SECONDS = 0.2  # of a fit that is worth a file
MOST_FILES = 100
DIGEST = hashlib.sha256().digest_size
log = logging.getLogger(__name__)


class SheetRatios:
    """sheet_ratios of the edges of one mesh."""

    def __init__(self, fit: Callable[[], np.ndarray], arrange: Callable, rest_vertices, tets):
        """
        Args:
            fit: Returns them in the order that follows from the tets.
            arrange: Brings them into the order of the constraints, and adds those of braces.
        """
        self._fit, self._arrange, self._mesh = fit, arrange, (rest_vertices, np.array(tets))
        self._values, self._lock, self._begun = None, Lock(), False
        self._leader = None  # the SheetRatios that these follow

    @property
    def ready(self) -> bool:
        """Whether it takes less than a second to have them."""
        if self._values is not None:
            return True
        return len(self._mesh[1]) < MANY_TETS if self._leader is None else self._leader.ready

    def begin(self) -> None:
        """Work them out in a thread of their own."""
        if self._values is None and not self._begun:
            self._begun = True
            thread = Thread(target=self.values, name="thin parts", daemon=True)
            thread.start()
            atexit.register(_end, thread)

    def follow(self, ends, other, other_ends) -> None:
        """Have those that the same edges have in another mesh, and 1 where it has no such edge.

        Args:
            ends: Of the edges of this mesh.  [E, 2]
            other: The other mesh's SheetRatios.
            other_ends: [F, 2]
        """

        def taken():
            count = max(ends.max(initial=0), other_ends.max(initial=0)) + 1
            keys, others = (
                np.sort(each, axis=1).astype(np.int64) @ [count, 1] for each in (ends, other_ends)
            )
            order = np.argsort(others)
            places = np.searchsorted(others[order], keys).clip(max=len(others) - 1)
            found = order[places]
            return np.where(others[found] == keys, other.values()[:, found], [[1.0], [0.0]])

        self._fit, self._arrange, self._leader = taken, lambda values: values, other

    def values(self) -> np.ndarray:
        """Those at sheets.RATIO, and how their logarithms grow with Poisson's ratio.  [2, E]"""
        with self._lock:
            if self._values is None:
                self._values = self._arrange(self._worked_out())
                self._fit = self._arrange = None
        return self._values

    def at(self, poisson_ratio: float) -> np.ndarray:
        """Those of a material of this Poisson's ratio.  [E]"""
        ratios, slopes = self.values()
        return ratios * np.exp(slopes * (poisson_ratio - sheets.RATIO))

    def _worked_out(self):
        path = _path_of(*self._mesh) if self._leader is None else None
        values = None if path is None else _read(path)
        if values is not None:
            return values
        since = time.perf_counter()
        # Matrices are small: a second thread of BLAS takes a core and saves a tenth of the time,
        # and where other programs keep cores busy, threads wait for each other for minutes.
        with threadpool_limits(1, "blas"):
            values = self._fit()
        if path is not None and time.perf_counter() - since > LEAST_SECONDS:
            _write(path, values)
        return values


def _end(thread):
    """Raise SystemExit in a thread, and wait until it has ended: at most for one product.

    A process that ends while OpenBLAS is in use waits for its threads for ever, or crashes.
    """
    if thread.is_alive():
        ident, error = ctypes.c_ulong(thread.ident), ctypes.py_object(SystemExit)
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ident, error)
        thread.join()


def folder() -> Path:
    return user_cache_path("deformrf") / "thin"


def _path_of(rest_vertices, tets):
    """The file of a mesh; None if a change of the program would not be noticed."""
    sources = sorted(path for room in ROOMS for path in room.glob("*.py"))
    if not sources:
        return None
    digest = hashlib.sha256()
    for path in sources:
        digest.update(path.read_bytes())
    digest.update(np.ascontiguousarray(rest_vertices, np.float64))
    digest.update(np.ascontiguousarray(tets, np.int64))
    return folder() / digest.hexdigest()


def _read(path):
    """The numbers of a whole file, or None."""
    try:
        content = path.read_bytes()
        os.utime(path)  # the files that nobody reads go first
    except OSError:
        return None
    if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:
        return None
    return np.frombuffer(content[DIGEST:]).reshape(2, -1)


def _write(path, values):
    content = values.astype(np.float64).tobytes()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as partial:
            Path(partial).write_bytes(hashlib.sha256(content).digest() + content)
    except OSError as error:
        log.info("thin parts are fitted again at each start: %s", error)
        return
    with suppress(OSError):  # other processes may be at it, too
        oldest_first = sorted(path.parent.iterdir(), key=lambda each: each.stat().st_mtime)
        for each in oldest_first[:-MOST_FILES]:
            each.unlink()
