"""How much a report measures: quick or in full, on a CPU or on CUDA."""

from typing import NamedTuple


class Effort(NamedTuple):
    """How much is measured.

    Attributes:
        size: Of images that settings are compared in, both sides [pixels].
        view_count: Views from all around.
        pixel_count: Compared with the reference in each view.
        turns: Of timing settings.
        photo_count: Test views.
        photo_pixels: Compared in each of them.
        frame_size: Of images with and without what is left out, both sides [pixels].
        frame_turns, step_turns, start_turns: Repeats with and without it, of frames, of
            steps of the solver, of starts.
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
