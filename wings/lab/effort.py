"""The amount of work of a report: quick or in full, on a CPU or on CUDA."""

from typing import NamedTuple


class Effort(NamedTuple):
    """Sizes and repeats of the measurements."""

    size: int  # width and height of the images that compare settings [pixels]
    view_count: int  # from all around
    pixel_count: int  # of each view, compared with the reference
    turns: int  # repeats of each setting's time
    photo_count: int  # test views
    photo_pixels: int  # of each, compared
    moving_size: int  # width and height of images that move [pixels], on a CPU
    frame_size: int  # width and height of the images that measure omissions [pixels]
    frame_turns: int  # repeats with and without each omission, as the next two
    step_turns: int
    start_turns: int


EFFORTS = {  # (on a CPU, quick)
    (True, True): Effort(150, 2, 250, 4, 4, 400, 150, 120, 9, 60, 2),
    (True, False): Effort(200, 3, 800, 16, 10, 1000, 500, 300, 15, 150, 3),
    (False, True): Effort(400, 2, 250, 8, 4, 400, 0, 400, 9, 60, 2),
    (False, False): Effort(800, 3, 800, 24, 10, 1000, 0, 800, 15, 150, 3),
}
