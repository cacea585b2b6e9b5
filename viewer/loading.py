"""Preparation of the first picture: loads kernels, and finds the object's surface.

`prepare` runs in a thread, so that a window can show the progress.  Warp compiles a module
of kernels that neither its cache nor what is shipped compiled has, which takes a second or so each.
"""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import warp as wp

from ..core import deform, render
from ..core.base import shipped_kernels
from ..core.base.device import thread_count
from ..core.deform import TIME_STEP
from ..wings.rig import Skinner
from .document import Scene, visible_points

STAGES = ("kernels", "networks and tables", "the surface, from eight sides", "the solver")


class Progress:
    """The progress of `prepare`: its threads write, the window's thread reads."""

    def __init__(self, device: str):
        self.seconds: list[float] = []  # of the stages that are done
        self.compiling: set[str] = set()  # modules that are being compiled now
        self.compiled = False  # whether any was
        self.modules = kernel_modules(device)
        self._loaded: list[str] = []
        self._since = time.perf_counter()

    @property
    def fraction(self) -> float:
        done = len(self._loaded) + max(len(self.seconds) - 1, 0)
        return done / (len(self.modules) + len(STAGES) - 1)

    @property
    def stage(self) -> str:
        if self.seconds:
            return STAGES[min(len(self.seconds), len(STAGES) - 1)]
        verb = "compiling" if self.compiling else "loading"
        return f"{verb} kernels, {len(self._loaded)} of {len(self.modules)} modules done"

    @property
    def stage_seconds(self) -> float:
        """Seconds since the present stage began."""
        return time.perf_counter() - self._since

    def begin_module(self, name: str, cached: bool) -> None:
        if not cached:
            self.compiling.add(name)
            self.compiled = True

    def end_module(self, name: str) -> None:
        self.compiling.discard(name)
        self._loaded.append(name)

    def end_stage(self) -> None:
        self.seconds.append(self.stage_seconds)
        self._since = time.perf_counter()


def kernel_modules(device: str) -> list[str]:
    """Names of the Warp modules that a viewer launches on a device."""
    return [*render.kernel_modules(device), *deform.kernel_modules(device)]


def is_cached(name: str, device: str) -> bool:
    """Whether Warp has a binary of a module, as it is now, in its cache or we ship one.

    The answer depends on internals of Warp, and is only shown to the user: with a version of
    Warp that has other internals, every module is taken to be in the cache.
    """
    module, device = wp.get_module(name), wp.get_device(device)
    try:
        block_dim = 1 if device.is_cpu else module.options["block_dim"]
        folder = Path(wp.config.kernel_cache_dir) / module.get_module_identifier(block_dim)
        binary = "*.o" if device.is_cpu else f"*.sm{device.get_cuda_compile_arch()}*"
    except (AttributeError, KeyError, TypeError):
        return True
    cached = any(folder.glob("*.meta")) and any(folder.glob(binary))
    return cached or shipped_kernels.has(module, device, block_dim)


def load_kernels(device: str, progress: Progress) -> None:
    """Load the modules of kernels, and compile those that Warp's cache lacks."""

    def load(name):
        progress.begin_module(name, is_cached(name, device))
        wp.load_module(name, device)
        progress.end_module(name)

    # Side by side, Warp's compiler for the CPU takes longer than one after another.
    with ThreadPoolExecutor(1 if device == "cpu" else thread_count()) as pool:
        list(pool.map(load, progress.modules))  # the list raises what a thread raised
    progress.end_stage()


def prepare(field, name: str, device: str, progress: Progress):
    """Scene and renderer of a model, with every kernel that they launch."""
    load_kernels(device, progress)
    rest = field.mesh.rest_vertices
    renderer = render.Renderer(field, device)
    renderer.set_vertices(rest)
    progress.end_stage()
    points, steady = visible_points(renderer, rest)
    progress.end_stage()
    scene = Scene(field, name, device, points, steady=steady)
    _warm_up(scene.solver, has_bones=scene.rigging.bone_count > 0)
    progress.end_stage()
    return scene, renderer


def _warm_up(solver, has_bones):
    """Take a step with and one without a handle, so that all that steps need is loaded.

    And what bones need, if the model has some: the first pose would wait for a compiler.  Thin
    parts are fitted beside the first frames; nothing needs them before it moves.
    """
    if has_bones:
        wp.load_module(Skinner.__module__, solver.device)
    solver.set_compliances(*solver.material.compliances(solver.edges, solver.volumes))
    solver.grab(np.flatnonzero(~solver.pinned)[:1])
    solver.step(TIME_STEP)
    solver.release()
    solver.step(TIME_STEP)  # it also counts tangles
    solver.set_material(solver.material)
    solver.reset()
    solver.edges.sheet_ratios.begin()
