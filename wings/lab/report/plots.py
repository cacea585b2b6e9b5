"""Pictures of a report, drawn without a display."""

import io

import numpy as np

INK = "#333333"  # of axes and text


def new_figure(width: float, height: float):
    """A matplotlib figure of that size [inches], for png()."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", dpi=110)
    FigureCanvasAgg(figure)
    return figure


def label(axes, x: str, y="", log="", grid="both"):
    """Name both axes and draw a grid.

    Args:
        log: The axes that are logarithmic: ticks at 1, 2 and 5 are written as plain numbers.
        grid: The axes that have lines.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes.set(xlabel=x, ylabel=y, **{f"{name}scale": "log" for name in log})
    for axis in (getattr(axes, f"{name}axis") for name in log):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_locator(NullLocator())
    axes.grid(axis=grid, linewidth=0.4)
    axes.set_axisbelow(True)


def png(figure) -> bytes:
    """The figure as a PNG of 256 colors, half of its size in true color."""
    from PIL import Image

    figure.canvas.draw()
    stream = io.BytesIO()
    image = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])
    image.quantize(256).save(stream, "PNG", optimize=True)
    return stream.getvalue()
