"""Coarse pictures one after the other, and the image that they become (upsampled.py)."""

from ...core.render import PastView, phases, places_before, strided
from .upsampled import CoarsePicture, UpsampledImage, object_box


class Upsampling:
    """Renders coarse pictures of one field, each through other pixels than the one before."""

    def __init__(self, ctx, times):
        """Take an OpenGL context and FrameTimes."""
        self.image: UpsampledImage | None = None
        self._ctx, self._times = ctx, times
        self._stride = 1, 1  # of the last picture's rays
        self._count = 0  # of pictures since one had nothing before it
        self._since_change = 0  # of those, since camera or vertices changed

    @property
    def whole(self) -> bool:
        """Whether each pixel has had a ray of its own since the last change."""
        return self._since_change >= len(phases(self._stride))

    def changed(self) -> None:
        """Camera or vertices have changed."""
        self._since_change = 0

    def render(self, renderer, camera, stride, options, before=None, plain=None):
        """Render the next coarse picture of a camera, and make `image` new of it.

        Args:
            options: RenderOptions with details.
            before: The PastView of the image before, or None: then nothing is taken from it.
            plain: The ImageTexture of the image before, if that is not `image`.

        Returns:
            The coarse picture, an Image of core/render.
        """
        self._count = 0 if before is None else self._count
        phase = phases(stride)[self._count % len(phases(stride))]
        coarse = strided(camera, stride, phase)
        with self._times.task("render"):
            image = renderer.render(coarse, options)
        with self._times.task("draw"):
            colors = image.color_array()
            box, places = object_box(colors), None
            if box is not None:
                sight = before or PastView(camera, renderer.pose.vertices)
                places = places_before(image, coarse, renderer, sight, box).numpy()
            self._have_image((camera.width, camera.height), options.background, before is None)
            moved = self._since_change == 0
            picture = CoarsePicture(colors, box, places, stride, phase, moved)
            self.image.add(picture, camera, options.background, plain)
        self._stride = stride
        self._count, self._since_change = self._count + 1, self._since_change + 1
        return image

    def _have_image(self, size, background, empty):
        """Have an image of that size, without anything in it if it has to be empty."""
        if self.image is not None and self.image.size != size:
            self.release()
        if self.image is None:
            self.image, empty = UpsampledImage(self._ctx, size), True
        if empty:
            self.image.clear(background)

    def release(self) -> None:
        if self.image is not None:
            self.image.release()
        self.image = None
