"""What happens before the first picture: kernels are compiled, the object is looked at.

It runs in a thread, so that a window can say how far it is.  Warp compiles module by
module, which takes a second or more each at the first start and next to nothing later.
"""

import sys
import time

import warp as wp

from ..core.render import Renderer
from .scene import Scene
from .surface import visible_points

NEEDED = ("render.", "deform.", "field.encoding", "field.networks.mma")  # parts of core
CPU_ALONE, CUDA_ALONE = "deform.frame.cpu", "deform.frame.cuda"
OTHERS = ("networks and tables", "the surface, from eight sides", "the solver")


class Progress:
    """How far `prepare` is: its thread writes, the window's reads.

    Attributes:
        stages: Names, in order.
        seconds: Of the stages that are done.
    """

    def __init__(self, modules: list[str]):
        self.modules = modules
        count = len(modules)
        self.stages = [
            f"compiling kernels {k} of {count}: {name.rpartition('.')[2]}"
            for k, name in enumerate(modules, 1)
        ] + list(OTHERS)
        self.seconds: list[float] = []
        self._since = time.perf_counter()

    @property
    def fraction(self) -> float:
        return len(self.seconds) / len(self.stages)

    @property
    def current(self) -> tuple[str, float]:
        """The stage that is going on, and for how many seconds it has been."""
        stage = self.stages[min(len(self.seconds), len(self.stages) - 1)]
        return stage, time.perf_counter() - self._since

    def done(self) -> None:
        """The present stage is finished."""
        now = time.perf_counter()
        self.seconds.append(now - self._since)
        self._since = now


def kernel_modules(device: str) -> list[str]:
    """The modules of core that have been imported and whose Warp kernels a viewer needs there."""
    core = __package__.rpartition(".")[0] + ".core."
    not_here = core + (CUDA_ALONE if device == "cpu" else CPU_ALONE)
    if device != "cpu":
        from ..core.render.rounds import wavefront  # noqa: F401  or it is imported with the first image
    return sorted(
        name
        for name, module in list(sys.modules.items())
        if name.startswith(tuple(core + part for part in NEEDED))
        and name != not_here
        and any(isinstance(v, wp.Kernel) and v.module.name == name for v in vars(module).values())
    )


def prepare(field, name: str, device: str, progress: Progress):
    """Scene and renderer of a model, every kernel compiled."""
    for module in progress.modules:
        wp.load_module(module, device=device)
        progress.done()
    rest = field.mesh.rest_vertices
    renderer = Renderer(field, device)
    renderer.set_vertices(rest)
    progress.done()
    points = visible_points(renderer, rest)
    progress.done()
    scene = Scene(field, name, device, points)
    scene.warm_up()
    progress.done()
    return scene, renderer
