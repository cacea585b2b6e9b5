"""Assign pixels to threads: a warp gets a tile of neighboring pixels."""

import warp as wp

TILE_WIDTH, TILE_HEIGHT = wp.constant(8), wp.constant(4)  # pixels

wp.set_module_options({"enable_backward": False})


def pixel_threads(width: int, row_count: int) -> int:
    """Threads for all pixels of an image, a warp for each tile."""
    tiles = -(-width // TILE_WIDTH) * -(-row_count // TILE_HEIGHT)
    return tiles * TILE_WIDTH * TILE_HEIGHT


@wp.func
def pixel_of(thread: int, width: int):
    """Column and row of a thread's pixel; beside the image there may be some, too."""
    tile = thread / (TILE_WIDTH * TILE_HEIGHT)
    within = thread % (TILE_WIDTH * TILE_HEIGHT)
    tiles_across = (width + TILE_WIDTH - 1) / TILE_WIDTH
    column = (tile % tiles_across) * TILE_WIDTH + within % TILE_WIDTH
    return column, (tile / tiles_across) * TILE_HEIGHT + within / TILE_WIDTH
