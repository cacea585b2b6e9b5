"""One page about a capture, as a picture, before minutes are spent on training.

It has what to retake and what to take next, cameras, points and the object's box from above and
from the front, the sphere of directions, and each photograph with its blur and exposure.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from PIL import Image, ImageDraw
from PIL.ImageFont import load_default

from ...core.training import sharpness_weights
from .directions import Around, Gap, around, gaps
from .sphere import draw_sphere, letter

WIDTH, MARGIN, PLOT = 1560, 20, 560  # pixels
THUMBNAIL = (144, 108)  # pixels, at most
COLUMNS = 10
LINE = 180  # characters
STOP = 2.0  # a photograph that is so much brighter or darker than the median stands out
REACH = 1.25  # shown, over the cameras' distance
MOST_NAMED = 6
WHITE, BLACK, GRAY, RED, BLUE, GREEN = (
    (255, 255, 255), (20, 20, 20), (130, 130, 130), (205, 30, 30), (30, 80, 200), (20, 140, 60),
)  # fmt: skip


@dataclass(frozen=True)
class Shown:
    """A photograph on the page.

    Attributes:
        name: Of its file.
        image: Itself, small.  [h, w, 3] uint8
        sharpness, exposure: See sharpness.py.
        pose: Camera to world, OpenGL's axes; None if it isn't known.  [4, 4]
    """

    name: str
    image: np.ndarray
    sharpness: float
    exposure: float
    pose: np.ndarray | None


@dataclass(frozen=True)
class Judged:
    """What is wrong with photographs.

    Attributes:
        faults: Of each photograph, a word each.
        weights: How much each photograph counts in training, by its sharpness.
        view: Where photographs look from; None if no point is what most of them look at.
        gaps: Directions that no photograph shows.
    """

    faults: list[list[str]]
    weights: list[float]
    view: Around | None = None
    gaps: list[Gap] = field(default_factory=list)

    def sentences(self, shown, with_letters=False) -> list[str]:
        """What to retake, and what to take next, for the user.

        Args:
            with_letters: Those that the sphere of directions has are told, too.
        """
        told = []
        for fault, advice in (
            (
                "no camera",
                "take more photographs between these and their neighbors, and remove those of "
                "something else",
            ),
            ("blurred", "hold still, or use more light"),
            ("dark", "fix the exposure, and keep the sun or lamp behind you"),
            ("bright", "fix the exposure, and keep the sun or lamp behind you"),
        ):
            having = zip(shown, self.faults, strict=True)
            names = [photo.name for photo, faults in having if fault in faults]
            if fault == "blurred" and names:
                lowest = min(self.weights)
                advice += f"; such photographs count less in training, down to {lowest:.0%}"
            if names:
                more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
                told.append(f"{fault}: {', '.join(names[:MOST_NAMED])}{more} ({advice})")
        for number, gap in enumerate(self.gaps):
            told.append(f"{letter(number)}: {gap.sentence}" if with_letters else gap.sentence)
        return told


def judge(shown: Sequence[Shown]) -> Judged:
    """Find photographs that stand out, and directions that no photograph shows."""
    weights = sharpness_weights([s.sharpness for s in shown]).tolist()
    exposure = np.median([s.exposure for s in shown])
    faults = []
    for photo, weight in zip(shown, weights, strict=True):
        words = [] if photo.pose is not None else ["no camera"]
        words += ["blurred"] if weight < 1.0 else []
        words += ["dark"] if photo.exposure * STOP < exposure else []
        words += ["bright"] if photo.exposure > exposure * STOP else []
        faults.append(words)
    posed = [s for s in shown if s.pose is not None]
    view = around([s.name for s in posed], [s.pose for s in posed])
    return Judged(faults, weights, view, [] if view is None else gaps(view))


def gaps_of(names, poses) -> list[str]:
    """Sentences about directions that no photograph shows."""
    view = around(names, poses)
    return [] if view is None else [gap.sentence for gap in gaps(view)]


def page_of(
    title: str,
    shown: Sequence[Shown],
    points: np.ndarray,
    colors: np.ndarray,
    corners: np.ndarray | None = None,
    doubts: Sequence[str] = (),
) -> Image.Image:
    """Draw the page.

    Args:
        title: One line.
        shown: Photographs.  [N] Shown
        points, colors: Sparse points, may be none.  [n, 3] and [n, 3] uint8
        corners: Of the object's box, the lower four first, around; None without.  [8, 3]
        doubts: Sentences about the cameras.
    """
    judged = judge(shown)
    lines = [line for doubt in doubts for line in textwrap.wrap(doubt, LINE)]
    lines += judged.sentences(shown, with_letters=True)
    color = RED if lines else GRAY
    lines = lines or ["Nothing to retake was found."]
    rows = -(-len(shown) // COLUMNS)
    top, cell = MARGIN + 34 + 24 * len(lines), THUMBNAIL[1] + 44
    page = Image.new("RGB", (WIDTH, top + PLOT + 50 + rows * cell + MARGIN), WHITE)
    draw = ImageDraw.Draw(page)
    draw.text((MARGIN, MARGIN), title, BLACK, load_default(20))
    for number, line in enumerate(lines):
        draw.text((MARGIN, MARGIN + 32 + 24 * number), fitted(line, LINE), color, load_default(16))
    width = (WIDTH - 4 * MARGIN) // 3
    panels = [
        plot(name, y, (width, PLOT), shown, judged, points, colors, corners)
        for name, y in (("from above", 1), ("from the front", 2))
    ]
    if judged.view is not None:
        panels.append(draw_sphere(judged.view, judged.gaps, (width, PLOT)))
    for number, panel in enumerate(panels):
        page.paste(panel, (MARGIN + number * (width + MARGIN), top + 10))
    captions = map(words_about, judged.faults, judged.weights)
    for number, (photo, words) in enumerate(zip(shown, captions, strict=True)):
        column, row = number % COLUMNS, number // COLUMNS
        draw_photo(page, draw, (MARGIN + column * 153, top + PLOT + 40 + row * cell), photo, words)
    return page


def words_about(faults, weight: float) -> str:
    """What is wrong with a photograph, and how much a blurred one counts; empty if nothing is."""
    share = f" ({weight:.0%})"
    return ", ".join(fault + (share if fault == "blurred" else "") for fault in faults)


def draw_photo(page, draw, place, photo: Shown, words: str):
    """A photograph, its name, bars of its sharpness and exposure, and `words_about` it."""
    x, y = place
    small = Image.fromarray(photo.image)
    small.thumbnail(THUMBNAIL)
    page.paste(small, place)
    if words:
        draw.rectangle((x - 2, y - 2, x + small.width + 1, y + small.height + 1), None, RED, 3)
    below = y + THUMBNAIL[1]
    caption = ": ".join(filter(None, (photo.name, words)))
    draw.text((x, below + 1), fitted(caption, 26), RED if words else GRAY, load_default(12))
    for number, (value, color) in enumerate(((photo.sharpness, BLUE), (photo.exposure, GREEN))):
        bar = (x, below + 19 + 7 * number, x + THUMBNAIL[0], below + 23 + 7 * number)
        draw.rectangle(bar, (230, 230, 230))
        length = THUMBNAIL[0] * float(np.clip(value, 0.0, 1.0))
        draw.rectangle((bar[0], bar[1], bar[0] + length, bar[3]), color)


def plot(name, y, size, shown, judged: Judged, points, colors, corners) -> Image.Image:
    """Cameras, points and the box along x and axis y of the frame of directions.py."""
    image = Image.new("RGB", size, (246, 246, 246))
    poses = np.array([s.pose for s in shown if s.pose is not None]).reshape(-1, 4, 4)
    if not len(poses):
        return image
    view = judged.view
    center = poses[:, :3, 3].mean(axis=0) if view is None else view.center
    axes = (np.eye(3) if view is None else view.turn)[[0, y]]
    reach = REACH * np.linalg.norm(poses[:, :3, 3] - center, axis=1).max() + 1e-9
    scale = 0.5 * min(size) / reach

    def pixels(places):
        """[..., 3] -> [..., 2]"""
        flat = (np.asarray(places, float) - center) @ axes.T * [scale, -scale]
        return flat + 0.5 * np.array(size)

    seen = np.asarray(image).copy()
    columns, rows = np.round(pixels(points)).astype(int).T if len(points) else np.zeros((2, 0), int)
    inside = (columns >= 0) & (columns < size[0] - 1) & (rows >= 0) & (rows < size[1] - 1)
    for right, down in ((0, 0), (1, 0), (0, 1), (1, 1)):
        seen[rows[inside] + down, columns[inside] + right] = np.asarray(colors)[inside]
    image = Image.fromarray(seen)
    draw = ImageDraw.Draw(image)
    if corners is not None:
        ends = pixels(corners)
        for one in range(4):
            after = (one + 1) % 4
            for a, b in ((one, after), (one + 4, after + 4), (one, one + 4)):
                draw.line((*ends[a], *ends[b]), GREEN, 2)
    length = 0.07 * reach
    faults = [f for f, s in zip(judged.faults, shown, strict=True) if s.pose is not None]
    for pose, words in zip(poses, faults, strict=True):
        color = RED if words else BLUE
        eye = pixels(pose[:3, 3])
        far = pose[:3, 3] - length * pose[:3, 2]
        for side in (-0.5, 0.5):
            draw.line((*eye, *pixels(far + side * length * pose[:3, 0])), color, 1)
        draw.ellipse((*(eye - 3), *(eye + 3)), color)
    words = f"{name}: cameras blue" + ("" if corners is None else ", the object's box green")
    draw.text((8, 6), words, BLACK, load_default(14), stroke_width=3, stroke_fill=WHITE)
    return image


def fitted(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 3] + "..."
