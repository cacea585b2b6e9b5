"""The amount of work of a report: quick or in full, on a CPU or on CUDA."""

from typing import NamedTuple


class Effort(NamedTuple):
    """Sizes and repeats of the measurements.

    Attributes:
        size: Width and height of the images that compare settings [pixels].
        view_count: Number of views from all around.
        pixel_count: Pixels per view that are compared with the reference.
        turns: Repeats of each setting's time.
        photo_count: Number of test views.
        photo_pixels: Compared pixels per test view.
        frame_size: Width and height of the images that measure omissions [pixels].
        frame_turns, step_turns, start_turns: Repeats with and without each omission, of
            frames, solver steps and starts.
        compilations: Repeats of compiling kernels, which takes long.
    """

    size: int
    view_count: int
    pixel_count: int
    turns: int
    photo_count: int
    photo_pixels: int
    frame_size: int
    frame_turns: int
    step_turns: int
    start_turns: int
    compilations: int


EFFORTS = {  # (on a CPU, quick)
    (True, True): Effort(150, 2, 250, 4, 4, 400, 120, 9, 60, 2, 1),
    (True, False): Effort(200, 3, 800, 16, 10, 1000, 300, 15, 150, 3, 3),
    (False, True): Effort(400, 2, 250, 8, 4, 400, 400, 9, 60, 2, 1),
    (False, False): Effort(800, 3, 800, 24, 10, 1000, 800, 15, 150, 3, 3),
}
