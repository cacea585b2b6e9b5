"""Pictures of a report, drawn without a display."""

import io

import numpy as np

INK = "#333333"  # of axes and text
MARK = 4.0  # pixels: half the size of what marks a point
APART = 15.0  # pixels between a label and other points, lest it seem theirs
LABEL_PLACES = (  # beside a point, in 1/72 inches, and which side of the label is there
    *(((4, 3), "left"), ((4, -8), "left")),
    *(((-4, 3), "right"), ((-4, -8), "right")),
    *(((0, 6), "center"), ((0, -11), "center")),
)


def new_figure(width: float, height: float):
    """A matplotlib figure of that size [inches], for png()."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", dpi=110)
    FigureCanvasAgg(figure)
    return figure


def log_scale(axis):
    """Make an axis logarithmic, with ticks at 1, 2 and 5 that are written as plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    scale = axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale
    scale("log")
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def label_points(axis, names, points):
    """Write each point's name beside it, those first that come first; what has no room is left out.

    Args:
        axis: With everything else drawn, as its limits stay what they are.
        names: Nothing is written for one that is empty, and nothing over its point.  [N]
        points: In the axis' own units.  [N, 2]
    """
    figure = axis.figure
    figure.draw_without_rendering()  # where the layout puts the axis
    renderer = figure.canvas.get_renderer()
    marks = [axis.transData.transform(point) for point in points]
    taken = []
    for number, (name, point) in enumerate(zip(names, points, strict=True)):
        others = [mark for mark in marks if np.hypot(*(mark - marks[number])) > 0.0]
        near = [_around(mark, APART) for mark in others] + [_around(marks[number], MARK)]
        for place, side in LABEL_PLACES if name else ():
            label = axis.annotate(
                *(name, point),
                xytext=place,
                textcoords="offset points",
                horizontalalignment=side,
                fontsize=6,
                color=INK,
            )
            box = label.get_window_extent(renderer)
            inside = axis.bbox.x0 < box.x0 and box.x1 < axis.bbox.x1
            if inside and not box.count_overlaps([*near, *taken]):
                taken.append(box)
                break
            label.remove()


def _around(place, reach):
    from matplotlib.transforms import Bbox

    return Bbox([place - reach, place + reach])


def png(figure) -> bytes:
    """The figure as a PNG of 256 colors, half of its size in true color."""
    from PIL import Image

    figure.canvas.draw()
    stream = io.BytesIO()
    image = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])
    image.quantize(256).save(stream, "PNG", optimize=True)
    return stream.getvalue()
