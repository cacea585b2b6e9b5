"""The programs of README and docs run, and those of docs/api.md give what it says."""

import re
import shutil
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from captures import circle, write_capture
from PIL import Image

from deformrf.core.field import load
from deformrf.core.render import look_at
from deformrf.viewer.document import Scene, save_session, start_of

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PROGRAMS = {  # those of a page are one, as each goes on from the one before
    str(page.relative_to(ROOT)): blocks
    for page in PAGES
    if (blocks := re.findall(r"^```python\n(.*?)^```", page.read_text("utf-8"), re.M | re.S))
}
SIZE = 32  # pixels
LIFT = 0.05  # of a control point in the session, model units


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


def write_session(path, field):
    """A control point is dragged upwards for ten ticks."""
    scene = Scene(field, "ball", "cpu")
    start = start_of(scene)
    scene.handles.grab(int(scene.handles.control_ids[0]))
    place = scene.handles.grabbed.target.place
    for tick in range(10):
        scene.handles.drag_to(np.add(place, (0.0, 0.0, LIFT * (tick + 1) / 10)))
        scene.clock.advance(1 / 60)
    save_session(scene, start, path)


@pytest.fixture
def prepare(tmp_path, monkeypatch, write_dataset, ball_file):
    """Put what a program reads into a new current folder."""

    def prepare(text):
        monkeypatch.chdir(tmp_path)
        for name in re.findall(r'load\("([\w/.-]+\.npz)"', text):
            Path(name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ball_file, name)
        if '"data"' in text:
            write_ball(tmp_path / "data", write_dataset)
        if '"photos"' in text:
            if not find_spec("pycolmap"):  # imported here, it would not be silent
                pytest.skip("needs pycolmap")
            write_capture(tmp_path / "photos", circle(16), np.random.default_rng(7))
        if '"session.jsonl"' in text:
            write_session(tmp_path / "session.jsonl", load(ball_file))

    return prepare


def picture(path):
    return np.asarray(Image.open(path)).astype(int)


def check_api(names):
    """What the programs of docs/api.md made."""
    rest, solver, top = names["rest"], names["solver"], names["top"]
    assert np.array_equal(picture("front.png"), names["image"].color_array()[..., :3])
    for pixels in (names["pixels"], names["bent"].color_array()):
        assert pixels.shape == (48, 64, 4) and pixels.dtype == np.uint8
        assert pixels[24, 32, 3] > 200 and pixels[0, 0, 3] == 0  # the object, the background
    assert (names["pixels"][0, 0] == 0).all()  # which is black there
    assert np.isinf(names["depth"][0, 0]) and 1.0 < names["depth"][24, 32] < 3.0
    way = solver.vertices.numpy() - rest
    np.testing.assert_allclose(way[top], (0.1, 0.0, 0.0), atol=1e-4)
    assert np.abs(way[solver.pinned]).max() < 1e-6
    poses = [picture("wavy.png"), names["bent"].color_array(), names["nod"].color_array()]
    for one, other in pairwise(pixels[..., :3].astype(int) for pixels in poses):
        assert np.abs(one - other).max() > 50
    assert names["psnr"] > 14.0  # 11 dB if nothing were learned
    assert load("trained.npz").mesh.tet_count == names["toy"].field.mesh.tet_count
    assert len(names["found"].photos) == 16 and names["views"].view_count == 14  # 2 are for tests
    assert load("half.npz").mesh.rest_vertices[:, 2].min() > 0.4 > rest[:, 2].min()
    assert names["names"] == ["nod"]
    lifted = names["vertices"] - rest
    assert abs(lifted[:, 2].max() - LIFT * 0.6) < 0.02  # after six of ten ticks
    colors = [line.split()[4:] for line in Path("posed.obj").read_text().splitlines()[1:4]]
    assert all(len(rgb) == 3 and 0.0 <= float(rgb[0]) <= 1.0 for rgb in colors)
    assert f"element tet {len(names['mesh'].tets)}".encode() in Path("mesh.ply").read_bytes()


def test_there_are_programs():
    assert "docs/api.md" in PROGRAMS and len(PROGRAMS["docs/api.md"]) >= 9


@pytest.mark.parametrize("page", PROGRAMS)
def test_the_programs_of_a_page_run(page, prepare):
    prepare("\n".join(PROGRAMS[page]))
    names = {}
    for number, program in enumerate(PROGRAMS[page], 1):
        exec(compile(program, f"{page}, program {number}", "exec"), names)
    if page == "docs/api.md":
        check_api(names)
