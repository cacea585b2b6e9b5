"""A figure becomes a PNG of the size that was asked for, with what was drawn in it."""

import io

import numpy as np
from PIL import Image

from deformrf.core.lab.report.plots import INK, label_points, new_figure, png


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


def labels(points, names, **limits):
    figure = new_figure(4.0, 3.0)
    axis = figure.subplots()
    axis.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0), **limits)
    label_points(axis, names, points)
    renderer = figure.canvas.get_renderer()
    found = {text.get_text(): text.get_window_extent(renderer) for text in axis.texts}
    return found, axis.bbox, [axis.transData.transform(point) for point in points]


def test_labels_lie_beside_their_points_and_apart():
    points = np.random.default_rng().uniform(0.02, 0.98, (80, 2))
    names = [f"setting {number}" for number in range(len(points))]
    found, frame, marks = labels(points, names)
    assert 3 < len(found) < 80  # there is no room for all
    boxes = list(found.values())
    for number, box in enumerate(boxes):
        assert not box.count_overlaps(boxes[:number])
        assert frame.x0 < box.x0 and box.x1 < frame.x1
        assert not any(box.contains(*mark) for mark in marks)
    for name, box in found.items():
        away = {
            other: np.hypot(max(box.x0 - x, 0, x - box.x1), max(box.y0 - y, 0, y - box.y1))
            for other, (x, y) in zip(names, marks, strict=True)
        }
        assert away[name] == min(away.values()) < 20.0  # nobody takes it for another's


def test_a_point_without_a_name_keeps_its_place():
    there = (0.5, 0.5)
    found, _, (mark, _) = labels([there, (0.46, 0.44)], ["", "near"])
    assert list(found) == ["near"] and not found["near"].contains(*mark)
