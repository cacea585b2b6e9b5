"""Photographs of a data set: what a camera took lies on what the model shows from there."""

import json
import subprocess
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from PIL import Image

from deformrf.core.base import images
from deformrf.core.render import Camera, Lens, Renderer, look_at, pinhole
from deformrf.core.training import DatasetError
from deformrf.viewer.actions import ACTIONS, show_photograph
from deformrf.viewer.camera import Covered, in_free_part
from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.camera import photographs as p
from deformrf.viewer.parts import call

LENSES = (
    pinhole(150.0, 120, 120),
    Lens(120, 100, (150.0, 140.0), (55.0, 53.0)),
    Lens(120, 100, (150.0, 140.0), (55.0, 53.0), (0.15, -0.05, 0.0, 0.0), (2e-3, -1e-3)),
)


def rolled(angle):
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return look_at([0.9, -1.3, 1.1], [0.5, 0.5, 0.5]) @ turn


@pytest.fixture
def folder(ball, tmp_path):
    """Photographs of the ball by three lenses, the camera rolled, in a space twice as large."""
    renderer, frames = Renderer(ball), []
    renderer.set_vertices(ball.mesh.rest_vertices)
    (tmp_path / "photos").mkdir()
    for number, lens in enumerate(LENSES):
        pose = rolled(0.3 * number)
        image = renderer.render(Camera(pose, lens)).color_array().copy()
        image[..., 3] = 255
        Image.fromarray(image).save(tmp_path / f"photos/{number}.png")
        pose[:3, 3] *= 2.0
        names = "fl_x", "fl_y", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2", "w", "h"
        numbers = *lens.focal, *lens.center, *lens.radial, *lens.tangential, lens.width, lens.height
        frame = {"file_path": f"photos/{number}.png", "transform_matrix": pose.tolist()}
        frames.append(frame | dict(zip(names, numbers, strict=True)))
    (tmp_path / "transforms_train.json").write_text(json.dumps({"frames": frames}))
    return tmp_path


@pytest.fixture
def to_model():
    return np.diag([0.5, 0.5, 0.5, 1.0])


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path, to_model, folder):
    """An App with panels, ready, with the photographs."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    made = App(*window, EventLog(False))
    made.load(replace(ball, world_to_model=to_model), "ball", "cpu")
    settings = made.scene.settings
    settings.fixed_resolution, settings.show_handles, settings.show_panel = 1.0, False, False
    made.frame(0.0)
    yield made
    made.close()


def shown(app, opacity):
    app.scene.settings.photo_opacity = opacity
    app.frame(0.0, whole=True)
    return app.canvas.read()[: -app.size[1] // 4].astype(float)  # above the message


@pytest.mark.gl
def test_a_photograph_lies_on_what_the_model_shows(app, folder):
    """Whatever its lens, and however the camera was rolled; a pixel's shift would be visible."""
    app.opening.asked = folder
    app.frame(0.0)
    for number, lens in enumerate(LENSES):
        ACTIONS["next_photograph"](app)
        said = app.recorder.message
        assert said.startswith(f"photograph {number + 1} of 3")
        assert ("distortion" in said) == lens.is_distorted
        render, photograph = shown(app, 0.0), shown(app, 1.0)
        assert 20 < render.std() and 0.02 < (render < 200).any(axis=-1).mean()
        error = abs(render - photograph).mean()
        for pixels in (1, -1):  # the best place is where it is
            for axis in (0, 1):
                moved = abs(np.roll(render, pixels, axis=axis) - photograph).mean()
                assert error < 0.9 * moved, (number, pixels, axis, error, moved)
    half = shown(app, 0.5)
    assert abs(half - 0.5 * (render + photograph)).max() <= 2.0
    app.scene.orbit = orbits.turned(app.scene.orbit, 40, 0, 100)  # it belongs to one camera only
    assert abs(shown(app, 1.0) - shown(app, 0.0)).max() == 0.0


@pytest.mark.gl
def test_beside_the_render_it_is_as_large(app, folder):
    app.opening.asked = folder
    app.frame(0.0)
    ACTIONS["previous_photograph"](app)
    ACTIONS["previous_photograph"](app)  # the one without distortion
    ACTIONS["place_photograph"](app)
    assert app.scene.settings.photograph == "beside"
    image = shown(app, 0.0)[24:]  # below the menus
    half = image.shape[1] // 2
    left, right = image[:, :half], image[:, half : 2 * half]
    assert left.std() > 20
    assert abs(left - right).mean() < 0.35 * abs(np.roll(left, 4, axis=1) - right).mean()
    before, settings = app.controls.camera, app.scene.settings
    settings.show_timeline = True  # less room: it is shown smaller
    app.frame(0.0)
    orbit = app.scene.orbit
    assert app.controls.camera.focal < 0.9 * before.focal
    app.frame(0.0)
    assert (app.scene.orbit.pose == orbit.pose).all()
    call(partial(show_photograph, where="hidden"), app)
    app.frame(0.0, whole=True)
    assert app.controls.covered.right == 0.0


@pytest.mark.gl
def test_without_a_data_set_the_keys_say_what_to_do(app):
    before = app.scene.orbit
    ACTIONS["next_photograph"](app)
    assert "--data" in app.recorder.message and app.scene.orbit is before


def test_the_camera_is_where_the_photograph_was_taken(folder, to_model):
    photographs = p.Photographs(folder, to_model)
    for _ in LENSES:
        one = photographs.step(1)
        room, covered = (200.0, 150.0), Covered(left=200.0, top=100.0)
        orbit = p.seen_from(one, orbits.Orbit(), (600, 400), room, np.full(3, 0.5))
        assert orbit.pose == pytest.approx(rolled(0.3 * photographs.index), abs=1e-9)
        assert p.is_seen_from(one, orbit)
        focal = in_free_part(orbits.camera_of(orbit, 600, 400), covered).focal
        reach = [
            max(c, side - c) * focal / f
            for c, side, f in zip(
                one.lens.center, one.pixels.shape[1::-1], one.lens.focal, strict=True
            )
        ]
        assert reach[0] == pytest.approx(200) or reach[1] == pytest.approx(150)
        assert reach[0] < 200.001 and reach[1] < 150.001
    assert photographs.step(1).name == "0"  # the first one again
    assert photographs.step(-1).name == "2"


def test_render_and_photograph_share_what_panels_leave_free():
    panel = Covered(left=300.0, bottom=100.0)
    over = p.places((1000, 600), panel, 1.0, "over")
    assert over == (panel, (650.0, 250.0), (350.0, 250.0), 300.0)
    both = p.places((2000, 1200), panel, 2.0, "beside")
    assert both.covered == Covered(300.0, 0.0, 350.0, 100.0)  # points
    assert (both.axis, both.half_size, both.left) == ((1650.0, 500.0), (350.0, 500.0), 1300.0)
    little = p.places((1000, 600), Covered(right=500.0), 1.0, "beside")
    assert little.covered == Covered(right=500.0) and little.axis == (750.0, 300.0)


def test_a_photograph_that_cant_be_shown_is_refused(folder, to_model, monkeypatch):
    Image.new("RGB", (120, 120)).save(folder / "photos/0.png", "GIF")
    photographs = p.Photographs(folder, to_model)
    with pytest.raises(DatasetError, match="can't be read as an image"):
        photographs.step(1)
    assert photographs.shown is None and photographs.step(1).name == "1"
    photographs = p.Photographs(folder, np.diag([1e3, 1e3, 1e3, 1.0]))
    with pytest.raises(DatasetError, match="model sizes away"):
        photographs.step(-1)
    photographs = p.Photographs(folder, to_model)
    monkeypatch.setattr(images, "MOST_PIXELS", 100)
    with pytest.raises(DatasetError, match="120x100 pixels"):
        photographs.step(-1)
    for path in (folder / "photos").iterdir():
        path.unlink()
    with pytest.raises(DatasetError, match="none of its photographs"):
        p.Photographs(folder, to_model)


def test_those_outside_the_folder_are_refused_unless_asked_for(folder, to_model, tmp_path):
    scene = tmp_path / "scene"
    scene.mkdir()
    (scene / "transforms_train.json").symlink_to(folder / "transforms_train.json")
    (scene / "photos").symlink_to(folder / "photos")
    with pytest.raises(DatasetError, match="outside the data set's folder"):
        p.Photographs(scene, to_model)
    assert p.Photographs(scene, to_model, outside=True).step(1).name == "0"


def test_no_torch_is_needed(folder):
    program = (
        "import sys; sys.modules['torch'] = None; import numpy as np;"
        "from deformrf.viewer.camera.photographs import Photographs;"
        f"print(Photographs({str(folder)!r}, np.eye(4)).step(1).pixels.shape)"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "(120, 120, 4)" in run.stdout
