"""A figure becomes a PNG of the size that was asked for, with what was drawn in it."""

import io

import numpy as np
from PIL import Image

from deformrf.wings.lab.report.plots import INK, new_figure, png


def test_a_figure_becomes_a_png_of_its_size():
    figure = new_figure(4.0, 2.5)
    axes = figure.subplots()
    axes.axhspan(0.0, 1.0, color=INK)
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0), xticks=[], yticks=[])
    image = Image.open(io.BytesIO(png(figure)))
    assert image.format == "PNG" and image.mode == "P" and image.size == (440, 275)
    pixels = np.asarray(image.convert("RGB"))
    assert (pixels[0, 0] == 255).all()  # the margin
    assert (pixels[137, 220] == int(INK[1:3], 16)).all()


def test_drawing_needs_no_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("MPLBACKEND", "tkagg")  # what pyplot would follow
    figure = new_figure(1.0, 1.0)
    figure.text(0.5, 0.5, "σ²")
    assert Image.open(io.BytesIO(png(figure))).size == (110, 110)
