"""The models that come with the program: who made them, their clips, and that they open."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from deformrf.core import field as fields
from deformrf.core.base.paths import ASSETS, BUNDLED
from deformrf.core.geometry import signed_volumes
from deformrf.wings import rig as rigs

MAKERS = ("PixelMannen", "tomkranis", "AsoboStudio", "scurest")
ADDRESS = "https://creativecommons.org/licenses/by/4.0/"


@pytest.fixture(scope="module")
def fox():
    return fields.load(BUNDLED["fox"])


def test_the_page_of_assets_has_each_model():
    page = (ASSETS / "README.md").read_text(encoding="utf-8")
    for name, path in BUNDLED.items():
        section = page.split(f"## `{name}.npz`")[1].split("\n## ")[0]
        field = fields.load(path)
        assert f"{field.mesh.tet_count:,} tets, {field.mesh.vertex_count:,} vertices" in section
        assert f"({path.stat().st_size / 1e6:.1f} MB)" in section
        assert f"{field.meta['test_mean']['psnr']:.2f} dB" in section


def test_the_fox_names_its_makers_wherever_it_goes(fox, tmp_path):
    license_text = " ".join((ASSETS / "LICENSE-fox.txt").read_text(encoding="utf-8").split())
    assert fox.attribution in license_text and ADDRESS in fox.attribution
    assert all(maker in fox.attribution for maker in MAKERS)
    low = [0.0, 0.0, 0.0, 1.0, 0.5, 1.0]
    made = {
        "cut": fields.cut(fox, np.reshape(low, (2, 3))),
        "without_rig": replace(fox, rig_arrays=None),
        "without_specks": fields.without_specks(fox, 0.01),
    }
    for name, field in made.items():
        path = tmp_path / f"{name}.npz"
        fields.save(field, path, entry_bits=16)
        assert fields.load(path).attribution == fox.attribution


def test_no_model_names_a_place_on_the_machine_that_made_it():
    for path in BUNDLED.values():
        with np.load(path) as arrays:
            for name in {"meta", "rig_meta"} & {*arrays.files}:
                assert "/" not in arrays[name].tobytes().decode().replace(ADDRESS, "")


def test_the_fox_has_three_clips_that_keep_its_tets(fox):
    mesh, rig = fox.mesh, rigs.rig_from(fox.rig_arrays, fox.mesh.vertex_count)
    assert [clip.name for clip in rig.clips] == ["Survey", "Walk", "Run"]
    rest = signed_volumes(mesh.rest_vertices, mesh.tets)
    for clip in rig.clips:
        assert clip.duration > 0.5
        quality = rigs.clip_quality(mesh, rig, clip, method="linear", untangle=False)
        # Legs fold where tets bridge them; all other tets keep their sides.
        assert quality.inverted.max() <= 0.035 * len(rest)


def start(command, *arguments):
    """A command in a process of its own: the fixture `window` has this one's OpenGL."""
    code = f"import sys; from deformrf.commands.{command} import main; sys.exit(main())"
    process = [sys.executable, "-c", code, *map(str, arguments), "--size", "64x48"]
    done = subprocess.run([*process, "--device", "cpu"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.usefixtures("window")  # skipped where there is no OpenGL
@pytest.mark.parametrize("name", BUNDLED)
def test_a_demo_opens(tmp_path, name):
    picture = "--screenshot", tmp_path / "a.png", "--transparent"
    start("view", "--demo", name, "--headless", "--frames", 1, *picture)
    with Image.open(tmp_path / "a.png") as image:
        assert 0.03 < (np.asarray(image)[..., 3] > 128).mean() < 0.6


@pytest.mark.usefixtures("window")
def test_a_clip_of_a_demo_moves(tmp_path):
    film = "-o", tmp_path / "run", "--frames", 2, "--fps", 4
    start("render", "--demo", "fox", "--clip", "Run", *film)
    pictures = [Image.open(path).convert("RGB") for path in sorted((tmp_path / "run").iterdir())]
    first, second = (np.asarray(picture, int) for picture in pictures)
    assert (abs(first - second).max(axis=-1) > 30).mean() > 0.01
