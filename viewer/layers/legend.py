"""Color scales for numbers, and a scale's legend: a bar with numbers and a word, at the right.

A legend is drawn into the canvas, not by the panels: then clips, films and screenshots have it.
Colors are 17 each of matplotlib's maps, which viewing does without.  Viridis rises in lightness
evenly, for what has a lowest value; coolwarm is gray in the middle, for what lies on both sides
of a normal value.
"""

from dataclasses import dataclass
from functools import lru_cache

import moderngl
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from . import gl

_HEX = {
    "viridis": "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 "
    "3fbc73 5ec962 84d44b addc30 d8e219 fde725",
    "coolwarm": "3b4cc0 4e68d8 6282ea 779af7 8db0fe a3c2fe b9d0f9 ccd9ed dddcdc ecd3c5 f5c4ac "
    "f7b093 f4987a eb7d62 dd5f4b ca3b37 b40426",
}
COLORS = {  # [17, 3] in 0..1, evenly spaced
    name: np.array([list(bytes.fromhex(color)) for color in colors.split()]) / 255.0
    for name, colors in _HEX.items()
}
TEXT, BOARD = (25, 27, 32, 255), (255, 255, 255, 215)
TICKS = 5
SMALLEST_FONT = 9  # pixels
LINES = 44  # of text would fill the picture's height


@dataclass(frozen=True)
class ColorScale:
    """Numbers as colors."""

    word: str  # what the numbers are
    colors: str  # one of COLORS
    low: float  # the number of the first color; lower ones have it, too
    high: float

    def share(self, values):
        """Where numbers [...] are in the scale: 0 at the low end, 1 at the high one.  [...]"""
        return np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0)

    def tick_texts(self) -> list[str]:
        """The numbers beside the bar, from the low end to the high one."""
        ticks = np.linspace(self.low, self.high, TICKS)
        texts = [f"{tick:.3g}" for tick in ticks]
        lowest = texts[0] if self.word == "strain" else "< " + texts[0]  # no strain is below 0
        return [lowest, *texts[1:-1], "> " + texts[-1]]


def colored(name: str, shares):
    """Colors of numbers [...], 0 for the first color and 1 for the last.  [..., 3]"""
    table = COLORS[name]
    places = np.linspace(0.0, 1.0, len(table))
    return np.stack([np.interp(shares, places, channel) for channel in table.T], axis=-1)


@lru_cache(maxsize=4)
def picture(scale: ColorScale, height: int):
    """The legend for a picture with so many rows.  [h, w, 4] uint8"""
    size = max(height // LINES, SMALLEST_FONT)
    font = ImageFont.load_default(size)
    texts, gap = scale.tick_texts(), round(0.6 * size)
    bar_width, bar_height = round(1.2 * size), 9 * size
    widest = max(font.getlength(text) for text in texts)
    width = round(max(font.getlength(scale.word), bar_width + gap + widest)) + 2 * gap
    top = 2 * gap + round(1.2 * size)  # of the bar
    image = Image.new("RGBA", (width, top + bar_height + 2 * gap), (255, 255, 255, 0))
    draw = ImageDraw.Draw(image)
    corner = image.width - 1, image.height - 1
    draw.rounded_rectangle((0, 0, *corner), radius=round(0.4 * size), fill=BOARD)
    draw.text((gap, gap), scale.word, TEXT, font)
    pixels = np.array(image)
    shares = 1.0 - (np.arange(bar_height) + 0.5) / bar_height  # the highest number is above
    bar = np.round(255.0 * colored(scale.colors, shares)).astype(np.uint8)
    pixels[top : top + bar_height, gap : gap + bar_width, :3] = bar[:, None]
    pixels[top : top + bar_height, gap : gap + bar_width, 3] = 255
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    for text, share in zip(texts, np.linspace(0.0, 1.0, len(texts)), strict=True):
        y = top + (1.0 - share) * bar_height
        draw.text((2 * gap + bar_width, y), text, TEXT, font, anchor="lm")
    return np.asarray(image)


class Legend:
    """The texture of the last legend that was drawn."""

    def __init__(self, ctx: moderngl.Context):
        self._ctx = ctx
        self._triangle = gl.full_screen(ctx, "overlay")
        self._texture = self._shown = None

    def release(self) -> None:
        if self._texture is not None:
            self._texture.release()
        self._texture = self._shown = None

    def draw(self, scale: ColorScale, size: tuple[int, int], covered: int = 0) -> None:
        """Draw it into a framebuffer of that size, which is in use, left of what is covered."""
        image = picture(scale, size[1])
        if self._shown is not image:
            self.release()
            self._texture = self._ctx.texture(image.shape[1::-1], 4, image.tobytes())
            self._shown = image
        width, height = self._texture.size
        margin = round(0.02 * size[1])
        left, bottom = size[0] - covered - margin - width, (size[1] - height) // 2
        gl.blend_over(self._ctx)
        self._ctx.viewport = left, bottom, width, height
        self._texture.use(0)
        self._triangle.program["picture"].value = 0
        self._triangle.render(moderngl.TRIANGLES)
        self._ctx.viewport = 0, 0, *size
