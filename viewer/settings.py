"""The user's choices and the drag in progress: plain data, without methods."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Settings:
    """What the user has chosen about picture and handles.

    Attributes:
        grab_radius: What a drag takes along, in object sizes.
        automatic_resolution: Follow the frame time while things move; otherwise
            `fixed_resolution` is the factor.
    """

    background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    grab_radius: float = 0.08
    automatic_resolution: bool = True
    fixed_resolution: float = 1.0
    show_handles: bool = True
    show_wireframe: bool = False
    show_panel: bool = True
    show_help: bool = False
    handles_in_clips: bool = True
    panel_in_screenshots: bool = False


@dataclass
class Grab:
    """A drag in progress: `vertex` and those around it move as one body.

    Attributes:
        ids: Vertices that move along, `vertex` among them.  [K]
        offsets: Their positions relative to `vertex` when it was grabbed.  [K, 3]
        target: Where `vertex` shall be.  [3]
        reached: Where it has been sent by the steps so far.  [3]
        before: Positions and velocities of all vertices when it was grabbed.
    """

    vertex: int
    ids: np.ndarray
    offsets: np.ndarray
    target: np.ndarray
    reached: np.ndarray
    before: tuple[np.ndarray, np.ndarray]
