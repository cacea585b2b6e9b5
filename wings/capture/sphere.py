"""The sphere of directions around an object as a picture: how far each is from a photograph.

Each half is a disc whose middle is straight above (or below), and whose rim is level.  The first
photograph is at the bottom of either, so left in the picture is left for who takes it.
"""

import numpy as np
from PIL import Image, ImageDraw
from PIL.ImageFont import load_default

from .directions import FAR, NEAR, Around, Gap, angles_to_nearest, azimuths, elevations, lowest

# Told apart by their lightness alone, too.
SEEN, HARDLY, MISSED = (128, 186, 232), (250, 222, 112), (166, 54, 10)
UNASKED, BACKGROUND = (222, 222, 222), (246, 246, 246)
DOT, RING, TEXT, WHITE = (10, 30, 90), (90, 90, 90), (20, 20, 20), (255, 255, 255)
STRIPES = 9  # pixels from one to the next, in what is missed
FINE = 3  # samples along a pixel's side
LEVELS = (30, 60)  # degrees, at which a ring is drawn
OUTLINE = {"stroke_width": 2, "stroke_fill": WHITE}  # of letters on colors
SHORT = 12  # characters of a name


def draw_sphere(view: Around, gaps: list[Gap], size: tuple[int, int]) -> Image.Image:
    """Both halves of the sphere, the photographs, the letters of gaps, and a legend."""
    image = Image.new("RGB", size, BACKGROUND)
    width, height = size
    big, small = int(min(0.39 * width, 0.35 * height)), int(0.1 * width)
    top, bottom = (width // 2, 62 + big), (width - small - 38, height - small - 16)
    for middle, radius, sign in ((top, big, 1.0), (bottom, small, -1.0)):
        disc = draw_disc(view, radius, sign)
        image.paste(disc, (middle[0] - radius, middle[1] - radius), disc)
    draw = ImageDraw.Draw(image)
    draw.text((8, 6), "how well directions are seen, from above", TEXT, load_default(14))
    x, y = top
    front = f"front ({short(view.names[0])})"
    for place, words, anchor in (
        ((x, y - big - 6), "behind", "ms"),
        ((x, y + big + 6), front, "mt"),
        ((x - big - 6, y), "left", "rm"),
        ((x + big + 6, y), "right", "lm"),
        ((bottom[0], bottom[1] - small - 5), "from below", "ms"),
    ):
        draw.text(place, words, TEXT, load_default(13), anchor=anchor)
    for level in LEVELS:
        r = big * (90 - level) / 90
        draw.ellipse((x - r, y - r, x + r, y + r), None, RING)
        draw.text((x, y - r), f"{level}°", TEXT, load_default(11), anchor="mm", **OUTLINE)
    draw_photos(draw, view, gaps, top, big, bottom, small)
    draw_legend(draw, (16, height - 98), lowest(view) >= 0.0)
    return image


def draw_disc(view: Around, radius: int, sign: float) -> Image.Image:
    """One half of the sphere in its colors, transparent around it."""
    fine = FINE * radius
    across = (np.arange(2 * fine) + 0.5) / fine - 1.0
    x, y = np.meshgrid(across, -across)
    away = np.hypot(x, y)
    angle = np.radians(90.0) * np.minimum(away, 1.0)
    flat = np.sin(angle) / np.maximum(away, 1e-9)
    directions = np.stack([flat * x, flat * y, sign * np.cos(angle)], axis=-1)
    angles = angles_to_nearest(directions, view.directions)
    row, column = np.indices(angles.shape)
    striped = ((row + column) // FINE % STRIPES < 2)[..., None]
    colors = np.where(striped, np.array(MISSED) // 2, MISSED)
    colors = np.where((angles <= FAR)[..., None], HARDLY, colors)
    colors = np.where((angles <= NEAR)[..., None], SEEN, colors)
    unasked = (elevations(directions) < lowest(view)) & (angles > NEAR)
    colors = np.where(unasked[..., None], UNASKED, colors)
    shape = np.where(away <= 1.0, 255, 0)[..., None]
    whole = np.concatenate([colors, shape], axis=-1).astype(np.uint8)
    return Image.fromarray(whole).resize((2 * radius, 2 * radius), Image.Resampling.BOX)


def place_of(direction, middle, radius: float):
    """Where a direction is in its disc.  [3] -> [2]"""
    r = radius * (90.0 - abs(elevations(direction))) / 90.0
    a = np.radians(azimuths(direction))
    return np.array(middle) + r * np.array([np.cos(a), -np.sin(a)])


def draw_photos(draw, view: Around, gaps, top, big, bottom, small):
    """A dot for each photograph, names of those that gaps name, and the gaps' letters."""
    named = {name for gap in gaps for name in gap.names} | {view.names[0]}

    def place(direction):
        return place_of(direction, *((top, big) if direction[2] >= 0.0 else (bottom, small)))

    for direction in view.directions:
        dot = place(direction)
        draw.ellipse((*(dot - 3), *(dot + 3)), DOT, WHITE)
    for name, direction in zip(view.names, view.directions, strict=True):
        if name in named:
            x, y = place(direction)
            draw.text((x, y - 4), short(name), TEXT, load_default(12), anchor="ms", **OUTLINE)
    for number, gap in enumerate(gaps):
        x, y = place(gap.middle)
        draw.ellipse((x - 11, y - 11, x + 11, y + 11), WHITE, TEXT)
        draw.text((x, y), letter(number), TEXT, load_default(15), anchor="mm")


def draw_legend(draw, place, stands: bool):
    x, y = place
    rows = [
        (SEEN, f"a photograph within {NEAR:.0f}°"),
        (HARDLY, f"within {FAR:.0f}°"),
        (MISSED, "none: letters are in the sentences"),
    ]
    rows += [(UNASKED, "below level: not asked for")] if stands else []
    for number, (color, words) in enumerate(rows):
        top = y + 19 * number
        draw.rectangle((x, top, x + 16, top + 13), color, RING)
        for shift in range(0, 27, STRIPES) if color == MISSED else ():
            a, b = max(shift - 13, 0), min(shift, 16)
            draw.line(
                (x + a, top + shift - a, x + b, top + shift - b), tuple(c // 2 for c in color)
            )
        draw.text((x + 23, top - 2), words, TEXT, load_default(13))
    top = y + 19 * len(rows)
    draw.ellipse((x + 5, top + 3, x + 11, top + 9), DOT, WHITE)
    draw.text((x + 23, top - 2), "a photograph", TEXT, load_default(13))


def letter(number: int) -> str:
    """Of a gap: A, B and so on."""
    return chr(ord("A") + number % 26)


def short(name: str) -> str:
    """A file's name without its ending; its end, if it is long."""
    stem = name.rpartition(".")[0] or name
    return stem if len(stem) <= SHORT else "…" + stem[1 - SHORT :]
