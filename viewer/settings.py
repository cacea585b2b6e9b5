"""What the user has chosen about picture, handles and files: plain data, without methods."""

from dataclasses import dataclass

TARGET_FPS, CPU_TARGET_FPS = 60.0, 10.0


@dataclass
class Settings:
    """The choices that the panels show.

    Attributes:
        mode: What the picture shows, one of core/render's MODES.
        checkerboard: Shown behind the object instead of `background`.
        grab_radius: What a drag takes along, in object sizes.
        soft_grab: A drag pulls with springs, weaker towards the radius, instead of moving
            what it takes along exactly, as one body.
        automatic_resolution: While things move, follow `target_fps`; otherwise
            `fixed_resolution` is the factor.
        accumulate: At rest, go on to the mean of images shifted by parts of a pixel.
        transparent_screenshots: The field alone, its opacity as the PNG's alpha.
        time_rendering: Measure the renderer's own stages, which makes it slower.
    """

    mode: str = "color"
    background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    checkerboard: bool = False
    grab_radius: float = 0.08
    soft_grab: bool = False
    automatic_resolution: bool = True
    fixed_resolution: float = 1.0
    target_fps: float = TARGET_FPS
    accumulate: bool = True
    show_handles: bool = True
    show_wireframe: bool = False
    show_panel: bool = True
    show_help: bool = False
    handles_in_clips: bool = True
    panel_in_screenshots: bool = False
    transparent_screenshots: bool = False
    time_rendering: bool = False
