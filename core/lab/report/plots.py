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


def log_scale(axis):
    """Make an axis logarithmic, with ticks at 1, 2 and 5 that are written as plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    scale = axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale
    scale("log")
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def png(figure) -> bytes:
    """The figure as a PNG of 256 colors, half of its size in true color."""
    from PIL import Image

    figure.canvas.draw()
    stream = io.BytesIO()
    image = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])
    image.quantize(256).save(stream, "PNG", optimize=True)
    return stream.getvalue()
