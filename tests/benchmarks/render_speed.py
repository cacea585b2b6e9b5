"""Frames per second, milliseconds by stage, memory, and the error against the reference beside.

    python tests/benchmarks/render_speed.py [--model M] [--ray-colors 128 128]
        [--device cpu|cuda:0] [--cases orbit drag fill] [--sizes 400 800] [--frames 40]

orbit: the camera goes around the object, which rests.
drag: a handle goes in a circle, the solver makes 20 substeps a frame, the camera stands
    still, and the image goes to where OpenGL draws it from, if there is one.
fill: as drag, at 1920x1080, so near that the object fills the image.

--ray-colors gives the model one color a ray, by a random network with hidden layers that wide.

Each frame is rendered anew, in default mode, at the pixels of the size.  fps and ms are those
of a run without waiting between the stages, which are measured in another run, one by one:
on CUDA their sum is larger; on the CPU it is the sum of both threads.  dB and max compare
3000 random pixels of the last pose with the float64 reference, which knows no shortcuts.
"""

import argparse
import time
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import warp as wp

from deformrf.core.base import paths
from deformrf.core.base.device import start_warp
from deformrf.core.definition.image import render_rays
from deformrf.core.deform import (
    TIME_STEP,
    Material,
    XpbdOptions,
    XpbdSolver,
    control_vertices,
    lowest_pins,
    vertices_within,
)
from deformrf.core.field import BASIS_COUNT, GEOMETRY_FEATURES, modelfile
from deformrf.core.render import (
    Renderer,
    RenderOptions,
    camera_rays,
    from_field_of_view,
    look_at,
)
from deformrf.core.training.metrics import psnr

REFERENCE_PIXELS = 3000
WARM_UP_FRAMES = 4
FILLING = 0.45  # distance of the camera that sees nothing but the object, of the usual one
CENTER = (0.5, 0.5, 0.5)


def camera(angle, width, height, distance=1.344):
    """A camera on a circle around the unit cube, by default at the training distance."""
    eye = 0.5 + distance * np.array([np.cos(angle) * 0.9, np.sin(angle) * 0.9, 0.43])
    return from_field_of_view(look_at(eye, CENTER), 0.691 * width / height, width, height)


class Orbit:
    """The object rests and the camera moves."""

    def __init__(self, renderer, size, frame_count):
        self.renderer, self.size, self.frame_count = renderer, size, frame_count
        self.vertices = renderer.field.mesh.rest_vertices
        renderer.set_vertices(self.vertices)

    def view(self, frame):
        return camera(2.0 * np.pi * frame / self.frame_count, *self.size)

    def frame(self, frame):
        return self.renderer.render(self.view(frame))


class Drag:
    """A handle at the top goes in a circle; `target` takes the images, if there is one."""

    def __init__(self, renderer, size, frame_count, target, distance=1.344):
        self.renderer, self.size, self.frame_count = renderer, size, frame_count
        self.target = target
        self.camera = camera(0.6, *size, distance)
        mesh = renderer.field.mesh
        rest = mesh.rest_vertices
        pins = lowest_pins(rest, mesh.tets)
        self.solver = XpbdSolver(
            rest, mesh.tets, Material(), pins, XpbdOptions(substep_count=20), renderer.device
        )
        ids = control_vertices(rest, np.flatnonzero(~pins), 40)
        handle = ids[np.argmax(rest[ids, 2])]
        self.ids = vertices_within(rest, handle, 0.05)
        self.ids = self.ids[~pins[self.ids]]
        self.solver.grab(self.ids)

    @property
    def vertices(self):
        return self.solver.vertices.numpy()

    def view(self, frame):
        return self.camera

    def frame(self, frame):
        angle = 0.1 * frame
        offset = 0.12 * np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
        stage = self.renderer.stage
        with stage("upload"):
            if self.target:
                self.target.prepare()
        with stage("solver"):
            self.solver.move(self.renderer.field.mesh.rest_vertices[self.ids] + offset)
            self.solver.step(TIME_STEP)
        self.renderer.set_vertices(self.solver.vertices)
        image = self.renderer.render(self.view(frame))
        with stage("upload"):
            if self.target:
                self.target.write(image)
        return image


@cache
def opengl():
    """A window that nobody sees, and its context: kept, or it is closed; None if there is none."""
    from deformrf.viewer.window import WindowError, open_window

    try:
        return open_window((64, 64), headless=True)
    except WindowError:
        return None


def opengl_target(device, size):
    """Where OpenGL reads images, and how the bytes go there."""
    from deformrf.viewer.layers import choose_path
    from deformrf.viewer.layers.upload import image_target

    if opengl() is None:
        return None, "nowhere: there is no OpenGL"
    _, context = opengl()
    path = choose_path(context, device, "auto")
    return image_target(context, size, device, path), path


def measure(case):
    """Median and spread of a frame in ms, mean stages in ms, samples per pixel, error."""
    renderer, device = case.renderer, case.renderer.device
    for frame in range(WARM_UP_FRAMES):  # kernels compile, allocators find their sizes
        case.frame(frame)
    wp.synchronize_device(device)
    seconds, sample_count = [], 0
    for frame in range(case.frame_count):
        start = time.perf_counter()
        image = case.frame(frame)
        wp.synchronize_device(device)
        seconds.append(time.perf_counter() - start)
        sample_count += image.sample_count
    stages = renderer.stage.seconds = {}
    for frame in range(case.frame_count):
        case.frame(frame)
    renderer.stage.seconds = None
    width, height = case.size
    low, middle, high = np.percentile(seconds, [10, 50, 90])
    return {
        "size": f"{width}x{height}",
        "fps": 1.0 / middle,
        "ms": 1e3 * middle,
        "p10": 1e3 * low,
        "p90": 1e3 * high,
        **{name: 1e3 * total / case.frame_count for name, total in stages.items()},
        "samples/px": sample_count / case.frame_count / (width * height),
        **error(case),
    }


def error(case):
    """PSNR and largest difference of random pixels to the reference."""
    renderer, view = case.renderer, case.view(case.frame_count - 1)
    image = case.renderer.render(view).color_array()[..., :3].reshape(-1, 3) / 255.0
    some = np.random.default_rng(0).choice(len(image), REFERENCE_PIXELS, replace=False)
    origins, directions = camera_rays(view)
    expected, _, _ = render_rays(
        renderer.field.definition,
        np.asarray(case.vertices, np.float32),
        origins[some],
        directions[some],
        RenderOptions().background,
    )
    off = 255.0 * np.abs(image[some] - expected).max()
    return {"dB": psnr(image[some], np.clip(expected, 0.0, 1.0)), "max/255": off}


def cases(name, renderer, arguments):
    """The cases of that name, one per size."""
    count = arguments.frames
    if name == "orbit":
        for size in arguments.sizes:
            yield Orbit(renderer, (size, size), count)
        return
    sizes = [(s, s) for s in arguments.sizes] if name == "drag" else [(1920, 1080)]
    distance = 1.344 if name == "drag" else FILLING * 1.344
    for size in sizes:
        target, path = opengl_target(arguments.device, size)
        print(f"{name}: frames go by {path}")
        yield Drag(renderer, size, count, target, distance)


def field_of(arguments):
    """The model that the arguments name, with random colors of rays if they say so."""
    field = modelfile.load(arguments.model)
    if not arguments.ray_colors:
        return field
    rng = np.random.default_rng(0)
    widths = GEOMETRY_FEATURES + BASIS_COUNT, *arguments.ray_colors, 3
    layers = tuple(
        (rng.normal(0.0, np.sqrt(2.0 / fan_in), (fan_in, fan_out)), np.zeros(fan_out))
        for fan_in, fan_out in pairwise(widths)
    )
    options = replace(field.options, deferred=True, color_hidden=tuple(arguments.ray_colors))
    layers = tuple((w.astype(np.float32), b.astype(np.float32)) for w, b in layers)
    return replace(field, options=options, color_layers=layers)


def add_arguments(parser, sizes, frames):
    parser.add_argument("--model", default=paths.DEFAULT_MODEL)
    parser.add_argument("--ray-colors", type=int, nargs="+")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--cases", nargs="+", default=["orbit"])
    parser.add_argument("--sizes", type=int, nargs="+", default=sizes)
    parser.add_argument("--frames", type=int, default=frames)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_arguments(parser, sizes=[400, 800], frames=8)
    arguments = parser.parse_args()
    start_warp()
    device = wp.get_device(arguments.device)

    def free():
        return device.free_memory if device.is_cuda else 0

    wp.zeros(1, device=device)  # the context
    before = free()
    renderer = Renderer(field_of(arguments), arguments.device)
    print(f"{renderer.device.name}, {arguments.frames} frames, ms per frame")
    for name in arguments.cases:
        for case in cases(name, renderer, arguments):
            row = {"case": name, **measure(case)}
            if device.is_cuda:
                row["GB"] = (before - free()) / 2**30
            print("".join(f"{key:>11}" for key in row))
            cells = (v if isinstance(v, str) else f"{v:.2f}" for v in row.values())
            print("".join(f"{cell:>11}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
