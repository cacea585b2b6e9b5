"""A model as a program holds it: a field, the pose that it has now, and who renders that pose."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import overload

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from .base.device import device_name
from .base.paths import BUNDLED, DEFAULT_MODEL
from .deform import Material, XpbdOptions, XpbdSolver, lowest_pins
from .field import TetField
from .field import load as load_field
from .field import save as save_field
from .render import Camera, Image, Renderer, RenderOptions, from_field_of_view, look_at

MARGIN = 1.05  # of a picture around the object


class Model:
    """A field in a pose that changes: `set_vertices`, then `render`.

    Attributes:
        field: The TetField, which is never changed.
        device: Warp's name of the device that renders and simulates.
    """

    def __repr__(self):
        mesh = self.field.mesh
        return f"Model({mesh.tet_count} tets, {mesh.vertex_count} vertices, on {self.device})"

    def __init__(self, field: TetField, device: str = "auto"):
        """Take a field, and a device: "cpu", "cuda:0", or "auto" for CUDA if the machine has it.

        Raises:
            ValueError: The device has another name, or this machine has no CUDA.
        """
        kind = device.partition(":")[0]
        if kind not in ("auto", "cpu", "cuda"):
            raise ValueError(f'there is no device "{device}": take "auto", "cpu" or "cuda:0"')
        if kind == "cuda":
            device_name("cuda")
        self.field = field
        self.device: str = device_name("auto") if device == "auto" else device

    @cached_property
    def renderer(self) -> Renderer:
        """What renders the model; made when it is first used."""
        return Renderer(self.field, self.device)

    @property
    def vertices(self) -> np.ndarray:
        """The positions now.  [V, 3] float32"""
        return np.array(self.renderer.pose.vertices.numpy())

    def set_vertices(self, vertices: ArrayLike | wp.array) -> None:
        """Take positions in model space, as Renderer.set_vertices does.  [V, 3]"""
        self.renderer.set_vertices(vertices)

    def solver(
        self,
        material: Material | None = None,
        pinned: ArrayLike | None = None,
        options: XpbdOptions | None = None,
    ) -> XpbdSolver:
        """A new solver of the model's dynamics, at rest; its `vertices` suit `set_vertices`.

        Args:
            material: By default that of Material().
            pinned: The vertices that stay where they are [V] bool; by default the lowest ones.
            options: By default with as many substeps as hold the material, as
                XpbdSolver.substeps_that_hold says.
        """
        rest, tets = self.field.mesh.rest_vertices, self.field.mesh.tets
        pinned = lowest_pins(rest, tets) if pinned is None else pinned
        solver = XpbdSolver(rest, tets, material or Material(), pinned, options, self.device)
        if self.field.stiffness is not None:
            solver.set_stiffness(self.field.stiffness)
        solver.edges.sheet_ratios.begin()
        if options is None:
            solver.set_options(XpbdOptions(substep_count=solver.substeps_that_hold()))
            solver.reset()
        return solver

    def camera(
        self,
        direction: ArrayLike = (0.0, -1.0, 0.3),
        width: int = 800,
        height: int = 800,
        angle_x: float = 0.6,
    ) -> Camera:
        """A camera that sees all of the object at rest, in the middle of the picture.

        Args:
            direction: From the object to the camera, in model space, where z is up.  [3]
            width, height: Of the picture [pixels].
            angle_x: Horizontal field of view [radians].

        Raises:
            ValueError: The direction has length 0.
        """
        if not np.any(direction):
            raise ValueError(f"the direction to the camera is {direction}: it has no length")
        mesh = self.renderer.shown.mesh
        points = mesh.rest_vertices[np.unique(mesh.tets)]
        center = 0.5 * (points.min(axis=0) + points.max(axis=0))
        radius = MARGIN * float(np.linalg.norm(points - center, axis=1).max())
        half_angle = min(0.5 * angle_x, np.arctan(np.tan(0.5 * angle_x) * height / width))
        away = np.asarray(direction, float) / np.linalg.norm(direction)
        up = (0.0, 0.0, 1.0) if abs(away[2]) < 0.999 else (0.0, 1.0, 0.0)
        pose = look_at(center + radius / np.sin(half_angle) * away, center, up)
        return from_field_of_view(pose, angle_x, width, height)

    @overload
    def render(
        self, camera: Camera | None = None, options: RenderOptions | None = None
    ) -> Image: ...
    @overload
    def render(
        self, camera: Sequence[Camera], options: RenderOptions | None = None
    ) -> list[Image]: ...
    def render(
        self, camera: Camera | Sequence[Camera] | None = None, options: RenderOptions | None = None
    ) -> Image | list[Image]:
        """An image of the pose, or a list of images for several cameras.

        Args:
            camera: By default `camera()`.

        Raises:
            TypeError: What is given is no camera.
            ValueError: See RenderOptions.
        """
        if isinstance(camera, list | tuple):
            return [self.renderer.render(one, options) for one in camera]
        return self.renderer.render(self.camera() if camera is None else camera, options)

    def save(self, path: str | Path) -> None:
        """Write the field to a model file; the pose is no part of it."""
        save_field(self.field, path)


def load(path: str | Path = DEFAULT_MODEL, device: str = "auto") -> Model:
    """Read a model file, an .npz; without a path, the bundled helmet.

    Args:
        path: A file, or the name of a bundled model: "helmet" or "fox".
        device: See Model.

    Raises:
        ModelFileError: The file is missing, is no model, has another version or is damaged.
    """
    return Model(load_field(BUNDLED.get(str(path), path)), device)
