"""README's first picture: three objects in large deformation, below photographs of them.

    python tests/benchmarks/three_objects.py --helmet assets/helmet.npz HELMET/train \\
        --fox assets/fox.npz FOX/train --toy TOY.npz TOY/photos [-o docs/figures/three.webp]

Each option takes a model and the folder of the photographs that it was trained on.  The solver
moves each model for two loops, and the second one is filmed, so that it ends where it begins.
That takes two minutes on two CPU cores.
"""

import argparse
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont, ImageOps

from deformrf.core import field as fields
from deformrf.core.deform import Material, XpbdOptions, XpbdSolver, lowest_pins, vertices_within
from deformrf.core.render import Renderer, from_field_of_view, look_at
from deformrf.viewer.camera import project
from deformrf.viewer.films.video import VideoWriter

SECONDS, FPS, TICKS = 5.0, 15, 4  # of the loop; ticks of the solver in a frame
START = 18  # the loop's frame that comes first: all three are bent in it
HEIGHT = 300  # of the moving pictures [pixels]
PHOTO, GAP, CAPTION, MARGIN = 84, 4, 30, 6  # [pixels]
FINE = 3  # rays along each side of a pixel
RED, INK, LINE = (222, 40, 36), (70, 74, 80), (222, 224, 228)


class Grip(NamedTuple):
    """A ball of vertices that is moved [model units]."""

    middle: tuple[float, float, float]
    radius: float
    pull: tuple[float, float, float]
    turn: float = 0.0  # about the vertical through the middle [radians]


class Hold(NamedTuple):
    """Grips are moved from `begin` on, stand still from `there` on, are let go at `end` [s]."""

    begin: float
    there: float
    end: float
    grips: tuple[Grip, ...]


class Show(NamedTuple):
    """How one object is shown."""

    photos: str  # their names
    bleed: float  # share of the photographs that is cut off at each side
    width: int  # of the moving picture [pixels]
    target: tuple[float, float, float]  # the camera looks there
    yaw: float  # [radians]
    height: float  # of what the picture shows at the target [model units]
    foot: float  # share of the object's height that is pinned
    floor: float  # what lies lower is left out [model units]
    material: Material
    holds: tuple[Hold, ...]


HELMET, TOY = (0.51, 0.52, 0.85), (0.55, 0.48, 0.91)  # the tops of their heads
FOX, TAIL = (0.5, 0.135, 0.655), (0.5, 0.88, 0.43)
SHOWS = {
    "helmet": Show(
        "r_2.png r_45.png r_56.png", 0.08, 270, (0.5, 0.5, 0.51), -0.45, 1.03, 0.16, 0.0,
        Material(young_modulus=2e5, damping=1.5),
        (
            Hold(0.0, 0.9, 1.3, (Grip(HELMET, 0.12, (-0.27, 0.13, -0.2)),)),
            Hold(1.3, 2.2, 2.4, (Grip(HELMET, 0.12, (0.27, -0.13, -0.12)),)),
            Hold(3.4, 4.3, 4.4, (Grip(HELMET, 0.25, (0.0, 0.0, 0.04), 2.8),)),
        ),
    ),
    "fox": Show(
        "r_27.png r_67.png r_49.png r_23.png", 0.04, 360, (0.5, 0.5, 0.55), 1.05, 0.88, 0.1, 0.0,
        Material(young_modulus=3e5, damping=3.5),
        (
            Hold(0.2, 1.0, 1.6, (
                Grip(FOX, 0.2, (0.0, 0.1, 0.2)), Grip(TAIL, 0.12, (0.0, -0.1, 0.38))
            )),
            Hold(2.8, 3.5, 4.0, (
                Grip(FOX, 0.2, (0.12, 0.05, 0.06), 1.0), Grip(TAIL, 0.12, (0.25, -0.1, 0.25))
            )),
        ),
    ),
    "toy": Show(
        "018.jpg 024.jpg 051.jpg", 0.08, 270, (0.52, 0.5, 0.5), -2.2, 1.2, 0.1, 0.04,
        Material(young_modulus=2.5e5, damping=2.0),
        (
            Hold(0.5, 1.1, 1.4, (Grip(TOY, 0.3, (0.0, 0.0, -0.27)),)),
            Hold(2.6, 3.6, 3.9, (Grip(TOY, 0.3, (0.0, 0.0, 0.1), 2.8),)),
        ),
    ),
}  # fmt: skip


class Hand:
    """Moves one object as its holds say."""

    def __init__(self, field, show):
        self.rest, tets = field.mesh.rest_vertices, field.mesh.tets
        pins = lowest_pins(self.rest, tets, show.foot)
        ground = XpbdOptions(ground=float(self.rest[:, 2].min()))
        self.solver = XpbdSolver(self.rest, tets, show.material, pins, ground)
        self.holds, self.held, self.parts = show.holds, None, []

    def advance(self, time):
        """Make one tick, which begins at that time of the loop [s]."""
        held = next((hold for hold in self.holds if hold.begin <= time < hold.end), None)
        if held is not self.held:
            self.held, now = held, self.solver.vertices.numpy()
            balls = [vertices_within(self.rest, *grip[:2]) for grip in held.grips] if held else []
            self.parts = [(ids, now[ids].copy()) for ids in balls]
            self.solver.grab(np.concatenate([[], *balls]).astype(int))
        if held:
            share = min((time - held.begin) / (held.there - held.begin), 1.0)
            self.share = share * share * (3.0 - 2.0 * share)
            parts = zip(held.grips, self.parts, strict=True)
            self.solver.move(np.concatenate([self.moved(*part) for part in parts]))
        self.solver.step(1.0 / (FPS * TICKS))

    def moved(self, grip, part):
        """Where a grip's vertices are to be."""
        (ids, start), share = part, self.share
        c, s = math.cos(share * grip.turn), math.sin(share * grip.turn)
        away = (self.rest[ids] - grip.middle) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        goal = grip.middle + away + share * np.array(grip.pull)
        return goal + (1.0 - share) * (start - self.rest[ids])

    def points(self):
        """Where the middles of the grips are now."""
        grips = self.held.grips if self.held else ()
        for grip, (ids, start) in zip(grips, self.parts, strict=True):
            behind = (1.0 - self.share) * (start - self.rest[ids]).mean(axis=0)
            yield grip.middle + self.share * np.array(grip.pull) + behind


def camera_at(show, share):
    """The camera, which sways a little, at that share of the loop."""
    yaw, tangent = show.yaw + 0.15 * math.sin(2.0 * math.pi * share), math.tan(0.25)
    away = np.array([math.sin(yaw), -math.cos(yaw), 0.2]) / math.hypot(1.0, 0.2)
    pose = look_at(show.target + 0.5 * show.height / tangent * away, show.target)
    angle = 2.0 * math.atan(tangent * show.width / HEIGHT)
    return from_field_of_view(pose, angle, FINE * show.width, FINE * HEIGHT)


def filmed(model, show):
    """The pictures of one object's second loop."""
    field = fields.load(model)
    box = field.mesh.rest_vertices.min(axis=0), field.mesh.rest_vertices.max(axis=0)
    box[0][2] = max(box[0][2], show.floor)
    field = fields.without_specks(fields.cut(field, box))
    hand, renderer, count = Hand(field, show), Renderer(field), round(SECONDS * FPS)
    for frame in range(START, START + 2 * count):
        if frame >= START + count:
            camera = camera_at(show, frame / count)
            renderer.set_vertices(hand.solver.vertices)
            picture = Image.fromarray(renderer.render(camera).color_array()[..., :3])
            for point in hand.points():
                pixel, draw = project(camera, [point])[0][0], ImageDraw.Draw(picture)
                draw.circle(pixel, 5.5 * FINE, RED, "white", round(1.3 * FINE))
            yield picture.reduce(FINE)
        for tick in range(TICKS):
            hand.advance((frame % count + tick / TICKS) / FPS)


def on_white(path, bleed):
    """A photograph, cut to a square, with a frame."""
    photo = Image.open(path).convert("RGBA")
    photo = Image.alpha_composite(Image.new("RGBA", photo.size, "white"), photo).convert("RGB")
    photo = ImageOps.fit(photo, (PHOTO, PHOTO), bleed=bleed)
    ImageDraw.Draw(photo).rectangle((0, 0, PHOTO - 1, PHOTO - 1), outline=LINE)
    return photo


def page_of(shows, folders):
    """What does not move: captions and photographs."""
    width = sum(show.width for show in shows)
    page = Image.new("RGB", (width, 2 * CAPTION + PHOTO + HEIGHT), "white")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(15)
    for text, y in ("photographs", CAPTION / 2), ("bent", CAPTION * 1.5 + PHOTO):
        draw.text((MARGIN, y), text, INK, font, anchor="lm")
        draw.line((2 * MARGIN + draw.textlength(text, font), y, width - MARGIN, y), LINE)
    left = 0
    for show, folder in zip(shows, folders, strict=True):
        names, step = show.photos.split(), PHOTO + GAP
        first = left + (show.width + GAP - step * len(names)) // 2
        for k, name in enumerate(names):
            page.paste(on_white(folder / name, show.bleed), (first + k * step, CAPTION))
        left += show.width
    return page


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in SHOWS:
        words = f"the model of the {name}, and the folder of its photographs"
        parser.add_argument(f"--{name}", type=Path, nargs=2, required=True, help=words)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/figures/three.webp"))
    arguments = parser.parse_args()
    models, folders = zip(*(getattr(arguments, name) for name in SHOWS), strict=True)
    page = page_of(SHOWS.values(), folders)
    writer = VideoWriter(arguments.output, page.size, FPS)
    for pictures in zip(*map(filmed, models, SHOWS.values()), strict=True):
        frame, left = page.copy(), 0
        for picture in pictures:
            frame.paste(picture, (left, page.height - HEIGHT))
            left += picture.width
        writer.push(np.asarray(frame))
    path = writer.close()
    print(f"{path}: {writer.frame_count} frames, {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
