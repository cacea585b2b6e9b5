"""deformrf rig quality: what the clips of a rig do to the tets of its model."""

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from ..core.base.arguments import File, Model, Name, writable_file
from ..core.base.paths import whole_file
from ..core.base.streams import printable
from ..core.geometry import boundary_faces
from ..wings import rig as rigs
from .options import OnCpu
from .rig_bind import rig_of_model

SIDE = 480  # of a view in the picture [pixels]
MARGIN = 0.06
VIEWS = {"front": (0, 2, 1.0), "side": (1, 2, -1.0)}  # axes across and up, which way is near
WELL, TORN = np.array([60, 120, 200]), np.array([230, 60, 40])  # colors of ratios 1 and 0


@dataclass(frozen=True)
class QualityArguments(OnCpu):
    """Print the smallest volume ratios and the inverted tets of each clip, per bone."""

    model: Model
    """Model file with a rig, an .npz."""
    clip: Name = None
    """The clip to look at; by default all."""
    method: rigs.Method = "linear"
    """How bones move vertices."""
    untangle: bool = False
    """Untangle inverted tets first, as the table after physics shows them."""
    picture: File = None
    """Picture to write, a .png: the worst moment. Red is torn, a ring is around the worst tet."""


def prepare_quality(arguments: QualityArguments):
    field, rig = rig_of_model(arguments.model)
    if not rig.clips:
        raise ValueError(f"{arguments.model} has no clips: a rig at rest tears nothing")
    clips = rig.clips if arguments.clip is None else (rig.clip(arguments.clip),)
    picture = None if arguments.picture is None else writable_file(arguments.picture, ".png")

    def job():
        found = []
        for clip in clips:
            options = {"method": arguments.method, "untangle": arguments.untangle}
            quality = rigs.clip_quality(field.mesh, rig, clip, **options)
            found.append((quality.worst.ratio, clip, quality))
            print("\n".join(map(printable, table(rig, clip, quality))))
        if picture is not None:
            _, clip, quality = min(found, key=lambda entry: entry[0])
            with whole_file(picture) as partial:
                drawn(field, quality).save(partial)
            print(printable(f"Wrote {picture}: {clip.name} at {quality.worst.seconds:.3g} s."))
        return 0

    return job


def table(rig: rigs.Rig, clip, quality: "rigs.TetQuality") -> list[str]:
    """Lines about one clip."""
    worst, names = quality.worst, rig.skeleton.names
    lines = [
        f"{clip.name}: {len(quality.times)} frames, smallest volume ratio "
        f"{quality.smallest.min():.2f}, at most {quality.inverted.max()} inverted tets in a frame"
    ]
    width = max(map(len, names))
    lines.append(f"  {'bone':{width}}  tets  smallest ratio  inverted")
    for bone in np.argsort(quality.bone_smallest, kind="stable").tolist():
        if quality.bone_tets[bone]:
            lines.append(
                f"  {names[bone]:{width}} {quality.bone_tets[bone]:5} "
                f"{quality.bone_smallest[bone]:15.2f} {quality.bone_inverted[bone]:9}"
            )
    place = " ".join(f"{v:.3f}" for v in worst.place)
    lines.append(
        f"  worst: tet {worst.tet} of {names[worst.bone]} at {worst.seconds:.3g} s, "
        f"at {place} in the rest pose"
    )
    return lines


def drawn(field, quality: "rigs.TetQuality") -> Image.Image:
    """The posed surface from the front and the side; tets' colors say their volume ratios."""
    faces, tets = boundary_faces(field.mesh.tets, field.neighbours)
    vertices = quality.worst_vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    scale = SIDE * (1.0 - 2.0 * MARGIN) / (high - low).max()
    share = np.clip(quality.worst_ratios[tets], 0.0, 1.0)[:, None]
    colors = share * WELL + (1.0 - share) * TORN
    page = Image.new("RGB", (SIDE * len(VIEWS), SIDE), "white")
    draw = ImageDraw.Draw(page)
    for number, (across, up, near) in enumerate(VIEWS.values()):
        middle = np.array([SIDE * (number + 0.5), SIDE * 0.5])

        def on_page(points, across=across, up=up, middle=middle):
            offset = scale * (points - 0.5 * (low + high))
            return np.stack([offset[..., across], -offset[..., up]], axis=-1) + middle

        depth = ({0, 1, 2} - {across, up}).pop()
        for face in np.argsort(-near * vertices[faces].mean(axis=1)[:, depth]):
            corners = [tuple(p) for p in on_page(vertices[faces[face]]).tolist()]
            draw.polygon(corners, tuple(colors[face].astype(int).tolist()), outline=(255, 255, 255))
        x, y = on_page(vertices[field.mesh.tets[quality.worst.tet]].mean(axis=0))
        draw.ellipse((x - 14, y - 14, x + 14, y + 14), outline=(0, 0, 0), width=3)
    return page
