"""The section on another model of the same object, as one that was trained without a part of the
method: what that part is worth for this object.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from ...core.base.streams import printable
from ...core.field import TetField
from ...core.render import Renderer, RenderOptions
from ...core.training import LEAVE_OUT
from .effort import Effort
from .rendering.pictures import PhotoPixels, photo_psnr, views
from .report.contents import Section, Table
from .stopwatch import Spread, compared

WHITE = RenderOptions(background=(1.0, 1.0, 1.0))
METHOD = [
    "Both models render a view of their object in turns; a line of the table has the median and in "
    "brackets the tenth and ninetieth percentile. Photographs are random pixels of the data set's "
    "test views, the same for both, over white.",
    "One color a ray (the default) is the color network's for the mean of what a ray meets. Where "
    "rays meet several surfaces that all show, as with glass, smoke, veils or hair, colors of "
    "samples (deformrf train --leave-out ray-color) may be better, and are slower.",
]


@dataclass(frozen=True)
class Compared:
    """One of two models."""

    which: Annotated[str, "model"]
    left_out: Annotated[str, "trained without"]
    color: Annotated[str, "one color a"]
    photographs: Annotated[float | None, "photographs [dB]"]
    tested: Annotated[float | None, "test views after training [dB]"]
    frame: Annotated[Spread, "frame [ms]"]
    megabytes: Annotated[float, "file [MB]"]
    seconds: Annotated[float | None, "training [s]"]


def section(
    models: list[tuple[TetField, Path]],
    device: str,
    effort: Effort,
    photos: list[list[PhotoPixels] | None],
) -> Section:
    """Compare two models.

    Args:
        models: The report's, and the other one; and their files.
        photos: Pixels of photographs for each, or None.
    """
    renderers = [Renderer(field, device) for field, _ in models]
    cameras = [views(field, 1, effort.size)[0] for field, _ in models]

    def frame(k):
        return lambda: renderers[k].render(cameras[k], WHITE)

    *frames, _ = compared(frame(0), frame(1), device, effort.frame_turns)
    rows = [
        row(field, path, renderer, time, pixels)
        for (field, path), renderer, time, pixels in zip(
            models, renderers, frames, photos, strict=True
        )
    ]
    caption = "Two models of one object."
    return Section(
        key="another",
        title="Another model",
        findings=[finding(*rows)],
        method=METHOD,
        tables=[Table("another", caption, rows)],
    )


def row(field: TetField, path, renderer, frame: Spread, photos) -> Compared:
    """What is known of a model, with the time of a frame and its pixels of photographs."""
    told = (field.meta.get("options") or {}).get("leave_out")
    words = [word for word in LEAVE_OUT if isinstance(told, list) and word in told]
    return Compared(
        which=printable(Path(path).stem),
        left_out=", ".join(words) or "–",
        color="ray" if field.options.deferred else "sample",
        photographs=photo_psnr(photos, renderer, WHITE) if photos else None,
        tested=(field.meta.get("test_mean") or {}).get("psnr"),
        frame=frame,
        megabytes=Path(path).stat().st_size / 1e6,
        seconds=field.meta.get("seconds"),
    )


def finding(own: Compared, other: Compared) -> str:
    """The difference in a sentence."""
    facts = []
    for name, of_what in (("photographs", "photographs"), ("tested", "its test views")):
        values = getattr(own, name), getattr(other, name)
        if None not in values:
            facts.append(f"{values[1] - values[0]:+.2f} dB on {of_what}")
            break
    times = other.frame.median / max(own.frame.median, 1e-9)
    facts.append(f"{times:.2f} times the time of a frame")
    facts.append(f"{other.megabytes / own.megabytes:.2f} times the file")
    return f"{_told(other)}, against {_told(own)}: {', '.join(facts)}."


def _told(model: Compared) -> str:
    parts = "all parts" if model.left_out == "–" else f"all parts but {model.left_out}"
    return f"{model.which} (trained with {parts}, one color a {model.color})"
