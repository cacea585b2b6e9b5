"""Ratios of thin parts (sheets.py): fitted when something needs them first, then kept on the disk.

A fit takes seconds, and its result depends on nothing but the mesh and the modules that fit.  A
file has the SHA-256 of its numbers, then these, in float64; a name is the SHA-256 of what they
depend on.  Where no file can be written, each process fits again.
"""

import hashlib
import logging
import time
from collections.abc import Callable
from pathlib import Path
from threading import Lock, Thread

import numpy as np
from platformdirs import user_cache_path

from ..base.paths import whole_file
from . import isotropy, layers, locking, quadratic, sheets, thin

FITTING = isotropy, layers, locking, quadratic, sheets, thin
LEAST_SECONDS = 0.2  # of a fit that is worth a file
MOST_FILES = 100
DIGEST = hashlib.sha256().digest_size
log = logging.getLogger(__name__)


class SheetRatios:
    """sheet_ratios of one mesh's edges and braces."""

    def __init__(self, fit: Callable[[], np.ndarray], rest_vertices, tets):
        self._fit, self._mesh = fit, (rest_vertices, tets)
        self._values, self._lock = None, Lock()

    def begin(self) -> None:
        """Work them out in a thread of their own."""
        if self._values is None:
            Thread(target=self.at, args=(sheets.RATIO,), name="thin parts", daemon=True).start()

    def at(self, poisson_ratio: float) -> np.ndarray:
        """For a material of this Poisson's ratio.  [E]"""
        with self._lock:
            if self._values is None:
                self._values = self._work_out()
        ratios, slopes = self._values
        return ratios * np.exp(slopes * (poisson_ratio - sheets.RATIO))

    def _work_out(self):
        path = self._path()
        values = _read(path)
        if values is None:
            since = time.perf_counter()
            values = self._fit()
            if time.perf_counter() - since > LEAST_SECONDS:
                _write(path, values)
        self._fit = self._mesh = None
        return values

    def _path(self):
        digest = hashlib.sha256()
        for module in FITTING:
            digest.update(Path(module.__file__).read_bytes())
        for array, kind in zip(self._mesh, (np.float64, np.int64), strict=True):
            digest.update(np.ascontiguousarray(array, kind))
        return folder() / digest.hexdigest()


def folder() -> Path:
    return user_cache_path("deformrf") / "thin"


def _read(path):
    """The numbers of a whole file, or None."""
    try:
        content = path.read_bytes()
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
        oldest_first = sorted(path.parent.iterdir(), key=lambda each: each.stat().st_mtime)
        for each in oldest_first[:-MOST_FILES]:
            each.unlink(missing_ok=True)
    except OSError as error:
        log.info("thin parts are fitted again at each start: %s", error)
