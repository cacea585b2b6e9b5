"""Extreme poses of a model's own mesh, and the renderer's error in them.

The poses are the starts of the stress cases (stress.py), a drag over 100 sizes, and shaken
handles.  The image is that of default mode.  All of its pixels are compared with
conformance mode; some of them with the float64 reference (in a random pose a ray crosses a
thousand tets at once).

Shapes: V vertices.
"""

from dataclasses import dataclass
from itertools import islice
from typing import Annotated

import numpy as np

from ....core.deform import TIME_STEP, Material, XpbdSolver, lowest_pins
from ....core.field import TetField
from ....core.geometry import signed_volumes
from ....core.render import Renderer, RenderOptions
from ..rendering.pictures import expected_pixels, largest_difference, picture_error, views
from ..rendering.section import BOUND, LARGEST
from ..stopwatch import Spread, milliseconds, spread_of
from .stress import CASES, STARTS, StressCase

SIZE = 32  # pixels: each may have thousands of samples
SHAKES = 5  # frames
WHITE = 254.5  # of 255: what is whiter shows nothing


@dataclass(frozen=True)
class PoseRow:
    """The renderer in one pose, in an image of SIZE x SIZE pixels."""

    pose: Annotated[str, "pose"]
    passed: Annotated[bool, "result"]  # at least BOUND dB, and nothing more than LARGEST off
    inverted: Annotated[int, "inverted tets"]
    shown: Annotated[int, "pixels that show it"]  # of those compared, by the reference
    psnr: Annotated[float, "PSNR [dB]"]
    largest: Annotated[float, "largest [1/255]"]  # of those compared with the reference
    largest_anywhere: Annotated[float, "all pixels, from conformance [1/255]"]
    frame: Annotated[Spread, "ms an image"]


def poses(field: TetField, device, seed=0) -> dict[str, np.ndarray]:
    """Names and vertices [V, 3]."""
    rest = field.mesh.rest_vertices
    rng = np.random.default_rng(seed)
    found = {"at rest": rest}
    for case in CASES:
        if case.drive and case.suits(field.mesh.tets):
            found[case.name] = _driven(field, case, device, rng)
        elif case.suits(field.mesh.tets) and case.start not in found:
            found[case.start] = STARTS[case.start](rest, rng)
    return found


def _driven(field, case: StressCase, device, rng):
    """The body after a case's first frames."""
    mesh = field.mesh
    pins = lowest_pins(mesh.rest_vertices, mesh.tets)
    solver = XpbdSolver(mesh.rest_vertices, mesh.tets, Material(), pins, device=device)
    for _ in islice(case.drive(solver, TIME_STEP, rng), SHAKES):
        solver.step(TIME_STEP)
    return solver.vertices.numpy().astype(float)


def measure(renderer: Renderer, name: str, vertices, pixel_count: int, repeats: int) -> PoseRow:
    """Render a pose and compare; half of the pixels are where the image shows something."""
    field, vertices = renderer.field, np.asarray(vertices, np.float32)
    camera = views(field, 1, SIZE)[0]

    def render():
        renderer.set_vertices(vertices)
        return renderer.render(camera)

    image = render().color_array()[..., :3]
    exact = renderer.render(camera, RenderOptions(conformance=True)).color_array()[..., :3]
    order = np.random.default_rng(0).permutation(SIZE * SIZE)
    shown = order[(image.reshape(-1, 3)[order] < WHITE).any(axis=1)]
    half = pixel_count // 2
    numbers = np.unique(np.concatenate([shown[:half], order[:half]]))
    expected = expected_pixels(field, vertices, camera, numbers)
    error, anywhere = picture_error([image], [expected]), largest_difference(image, exact)
    return PoseRow(
        pose=name,
        passed=error.psnr >= BOUND and max(error.largest, anywhere) <= LARGEST,
        inverted=int((signed_volumes(vertices, field.mesh.tets) < 0).sum()),
        shown=int((expected.colors < WHITE / 255.0).any(axis=1).sum()),
        psnr=error.psnr,
        largest=error.largest,
        largest_anywhere=anywhere,
        frame=spread_of([milliseconds(render, renderer.device) for _ in range(repeats)]),
    )
