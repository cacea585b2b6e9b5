"""The program of docs/api.md runs, and its results are what it says."""

import re
from pathlib import Path

import numpy as np
from PIL import Image

from deformrf.core.render import look_at

PAGE = Path(__file__).parents[1] / "docs" / "api.md"
SIZE = 32  # pixels


def write_ball(folder, write_dataset):
    """An orange ball from 14 sides."""
    x, y = np.meshgrid(*[np.arange(SIZE) - 0.5 * (SIZE - 1)] * 2)
    image = np.zeros((SIZE, SIZE, 4), np.uint8)
    image[np.hypot(x, y) < 0.27 * SIZE] = (230, 120, 20, 255)
    rng = np.random.default_rng(0)
    for split, count in (("train", 12), ("test", 2)):
        places = rng.normal(size=(count, 3))
        places *= 4.0 / np.linalg.norm(places, axis=1, keepdims=True)
        poses = [look_at(place, (0, 0, 0)) for place in places]
        write_dataset(folder, [Image.fromarray(image)] * count, split, poses=poses)


def test_the_program_of_the_page_runs(tmp_path, monkeypatch, write_dataset):
    write_ball(tmp_path / "data", write_dataset)
    monkeypatch.chdir(tmp_path)
    (program,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    names = {}
    exec(compile(program, str(PAGE), "exec"), names)
    assert names["psnr"] > 14.0  # 11 dB if nothing were learned
    way = names["solver"].vertices.numpy() - names["rest"]
    np.testing.assert_allclose(way[names["top"]], (0.1, 0.0, 0.0), atol=1e-4)
    assert np.abs(way[names["solver"].pinned]).max() < 1e-6
    image = names["image"]
    assert image.shape == (48, 64, 4) and image.dtype == np.uint8
    assert image[24, 32, 3] > 200 and image[0, 0, 3] == 0  # the object, the background
