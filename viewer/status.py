"""What the program reports about itself to the panels; no panel writes to it."""

import time
from dataclasses import dataclass, field

from .timing import StageTimes

MESSAGE_SECONDS = 6.0


@dataclass
class Status:
    """Facts for the read-outs.

    Attributes:
        device: The renderer's, with its name.
        interop: How frames reach OpenGL, "buffer" or "copy".
        gl_renderer: OpenGL's own name of what draws.
        resolution: Factor of the image that is shown, relative to the window.
        refined: The part of its rows that are at full resolution.
        sample_count, most_samples: Shifted images in its mean, and how many they will be.
        saved: On what else than pixels it saves, empty in full quality.
        recorder: The clip that is being recorded, if any.
    """

    device: str = ""
    interop: str = ""
    gl_renderer: str = ""
    resolution: float = 1.0
    refined: float = 1.0
    sample_count: int = 1
    most_samples: int = 1
    saved: str = ""
    recorder: object = None
    times: StageTimes = field(default_factory=StageTimes)
    _message: tuple[float, str] = (0.0, "")

    def say(self, message: str) -> None:
        """Show a line for a few seconds."""
        self._message = time.monotonic(), message

    @property
    def message(self) -> str:
        said_at, message = self._message
        return message if time.monotonic() - said_at < MESSAGE_SECONDS else ""
