"""Where all surfaces of a picture were in the image before."""

import warp as wp

from deformrf.core.render.temporal import Surfaces, place_before


@wp.kernel
def places_kernel(shown: Surfaces, places: wp.array2d(dtype=wp.vec4)):
    row, column = wp.tid()
    places[row, column] = place_before(shown, row, column)


def places_of(shown: Surfaces):
    """`place_before` of each pixel.  [h, w, 4]"""
    places = wp.empty(shown.depth.shape, dtype=wp.vec4, device="cpu")
    wp.launch(places_kernel, places.shape, [shown], [places], device="cpu")
    return places.numpy()
