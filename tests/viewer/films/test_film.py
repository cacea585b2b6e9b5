"""Films: the camera between views, and files that deformrf render writes of a session."""

import json
import os
import subprocess
import sys
from types import SimpleNamespace

import av
import numpy as np
import pytest
from PIL import Image

from deformrf.commands import render as render_command
from deformrf.viewer.camera import Orbit
from deformrf.viewer.camera import camera_of as camera_of
from deformrf.viewer.document import Event, Session, save_session, start_of
from deformrf.viewer.films import Film
from deformrf.viewer.films.film import Views, frame_count


def views(*events):
    return Views(Session({"ticks": 100}, list(events)), Orbit())


def test_the_camera_moves_evenly_between_views_of_one_move():
    track = views(
        Event(10, "view", {"yaw": 0.0, "distance": 2.0}),
        Event(20, "view", {"yaw": 1.0, "target": [1.0, 0.5, 0.5]}),
        Event(20, "grab", {}),
    )
    assert track.at(0.0).yaw == 0.0
    assert track.at(15.0).yaw == pytest.approx(0.5)
    assert track.at(15.0).target == pytest.approx([0.75, 0.5, 0.5])
    assert track.at(15.0).distance == 2.0
    assert track.at(99.0).yaw == 1.0


def test_the_camera_stands_between_views_that_are_far_apart():
    track = views(Event(10, "view", {"pitch": 0.1}), Event(80, "view", {"pitch": 0.9}))
    assert track.at(79.0).pitch == 0.1
    assert track.at(80.0).pitch == 0.9


def test_the_camera_turns_the_shorter_way():
    track = views(Event(10, "view", {"yaw": 3.0}), Event(20, "view", {"yaw": -3.0}))
    assert np.cos(track.at(15.0).yaw) == pytest.approx(-1.0)


def test_a_whole_turn_ends_where_it_began():
    film = Film(SimpleNamespace(orbit=Orbit()), None, 30, turn=2.0)
    first, last = (camera_of(film.orbit(tick), 8, 8) for tick in (0.0, 120.0))
    np.testing.assert_allclose(first.camera_to_world, last.camera_to_world, atol=1e-12)


@pytest.mark.parametrize("seconds, fps, frames", [(0.0, 30, 1), (1.0, 30, 31), (0.05, 10, 2)])
def test_a_film_shows_its_beginning_and_its_end(seconds, fps, frames):
    assert frame_count(seconds, fps) == frames


# -- blur and cuts -----------------------------------------------------------------------------


@pytest.fixture
def played(ball, recorded):
    """A function that makes a Film of the recorded session, on a scene of its own."""
    from deformrf.viewer.document import Scene, load_session

    session = load_session(recorded[1], ball)
    return lambda fps: Film(Scene(ball, "ball", "cpu"), session, fps)


def test_the_images_of_a_blurred_frame_lie_between_the_ticks(played):
    film, plain = played(24), played(60)
    poses = {}
    for tick in range(plain.count):
        plain.show(tick)
        poses[tick] = plain.scene.positions
    for frame in range(6, 9):  # 2.5 ticks each
        film.show(frame)
        moments = film.moments(frame, (32, 24), 5, shutter=1.0)
        for index, (camera, vertices) in enumerate(moments):
            tick = 2.5 * frame - 2.5 * (4 - index) / 5
            share = tick % 1.0
            before, after = poses[int(tick)], poses[int(np.ceil(tick))]
            np.testing.assert_allclose(vertices, (1 - share) * before + share * after, atol=1e-6)
            seen_from = camera_of(film.orbit(tick), 32, 24).camera_to_world
            np.testing.assert_allclose(camera.camera_to_world, seen_from)
    assert abs(moments[0][1] - moments[-1][1]).max() > 1e-4


def test_blur_changes_nothing_of_what_a_session_does(played, recorded):
    film = played(25)
    for frame in range(film.count):
        film.show(frame)
        moments = film.moments(frame, (32, 24), 3, shutter=0.5)
    assert np.array_equal(film.scene.positions, recorded[0].positions)
    assert np.array_equal(moments[-1][1], recorded[0].positions)


def test_a_cut_shows_these_ticks_alone(played):
    film, whole = played(30), played(30)
    film.cut(10, 20)
    assert (film.count, film.tick(0), film.tick(5)) == (6, 10, 20)
    film.show(0)
    whole.show(5)
    assert np.array_equal(film.scene.positions, whole.scene.positions)
    film.cut(30, 9999)
    assert film.last == whole.last
    with pytest.raises(ValueError, match="nothing from tick 500"):
        film.cut(500, None)


# -- the command -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ([], "-o film.mp4"),
        (["-o", "a.mp4"], "give --session, --clip, --turntable or --camera"),
        (["-o", "a.mp4", "--turntable", "1", "--camera", "p.json"], "leave one out"),
        (["-o", "a.mp4", "--session", "s", "--pose", "p.npy"], "it can't have a --pose"),
        (["-o", "a.mp4", "--session", "s", "--material", "gold"], "default, jelly, rubber"),
        (["-o", "a.mp4", "--turntable", "1", "--material", "clay"], "it needs --session"),
        (["-o", "a.avi", "--turntable", "1"], "has to end in .mp4 or .webm or .webp"),
        (["-o", "a.webm", "--turntable", "1", "--codec", "h264"], "has to end in .mp4"),
        (["-o", "a", "--turntable", "1", "--codec", "h264"], "is a folder of pictures"),
        (["-o", "a.mp4", "--turntable", "0"], "--turntable is 0"),
        (["-o", "a.mp4", "--turntable", "nan"], "--turntable is nan"),
        (["-o", "a.mp4", "--turntable", "1e9"], "3600 are the most"),
        (["-o", "a.mp4", "--turntable", "1", "--samples", "0"], "--samples is 0"),
        (["-o", "a.mp4", "--turntable", "1", "--samples", "9999"], "256 are the most"),
        (["-o", "a.mp4", "--turntable", "1", "--size", "9x9"], "32 to 8192"),
        (["-o", "a.mp4", "--turntable", "1", "--shutter", "1.5"], "a part of a frame: 0 to 1"),
        (["-o", "a.mp4", "--turntable", "1", "--shutter", "0.5"], "give 2 or more"),
        (["-o", "a.mp4", "--turntable", "1", "--from", "3"], "it needs --session"),
        (["-o", "a.mp4", "--session", "s", "--from", "3", "--to", "1"], "before --from"),
        (["-o", "a.mp4", "--turntable", "1", "--transparent"], "h264 has no opacity"),
        (["-o", "a.mp4", "--session", "nowhere.jsonl"], "nowhere.jsonl"),
        (["-o", "a.mp4", "--session", "s.jsonl", "--object-size", "1"], "leave --object-size out"),
        (["-o", ".", "--turntable", "1"], "a new or an empty folder"),
    ],
)
def test_what_makes_no_sense_is_explained(
    capfd, ball_file, tmp_path, monkeypatch, arguments, sentence
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").touch()
    assert render_command.main([str(ball_file), *arguments]) == 2
    out, err = capfd.readouterr()
    assert out == "" and err.startswith("deformrf render: ") and err.count("\n") == 1
    assert sentence in err
    assert [path.name for path in tmp_path.iterdir()] == ["there"]  # and nothing is left behind


def rendered(*arguments, timeout=120):
    """deformrf render in a process of its own, without a display."""
    clean = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    code = "import sys; from deformrf.commands.render import main; sys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments), "--device", "cpu"],
        env=clean,
        capture_output=True,
        text=True,
        timeout=timeout,
    )


def frames_of(path):
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


@pytest.fixture
def recorded(ball, tmp_path):
    """A scene after a drag with a turning camera, and its session."""
    from deformrf.viewer.camera import orbit as orbits
    from deformrf.viewer.document import Scene

    scene = Scene(ball, "ball", "cpu")
    scene.settings.grab_radius, scene.settings.show_handles = 0.3, False
    start, vertex = start_of(scene), int(scene.handles.control_ids[0])
    scene.clock.advance(1 / 60)
    scene.handles.grab(vertex)
    for _ in range(20):
        scene.handles.drag_to(np.add(scene.handles.grabbed.target.place, [0.0, 0.0, 0.01]))
        scene.orbit = orbits.turned(scene.orbit, 2.0, 0.5, 64)
        scene.clock.advance(1 / 30)
    return scene, save_session(scene, start, tmp_path / "s.jsonl")


@pytest.mark.gl
def test_a_film_ends_as_the_live_scene_looks(recorded, ball, ball_file, tmp_path, window):
    """The last frame, at the same size and in full, beside what the same scene shows now."""
    from deformrf.core.render import Renderer
    from deformrf.viewer.camera import orbit as orbits

    scene, session = recorded
    done = rendered(
        ball_file, "--session", session, "-o", tmp_path / "film", "--size", "96x64", "--fps", "15"
    )
    assert done.returncode == 0, done.stderr
    pictures = sorted((tmp_path / "film").iterdir())
    assert len(pictures) == frame_count(scene.journal.tick / 60, 15)
    last = np.asarray(Image.open(pictures[-1]).convert("RGB")).astype(int)
    renderer = Renderer(ball, "cpu")
    renderer.set_vertices(scene.solver.vertices)
    live = renderer.render(orbits.camera_of(scene.orbit, 96, 64)).color_array()[..., :3].astype(int)
    assert abs(last - live).max() <= 2
    first = np.asarray(Image.open(pictures[0]).convert("RGB")).astype(int)
    assert abs(first - last).max() > 50


@pytest.mark.gl
@pytest.mark.parametrize("name, codec", [("a.mp4", "h264"), ("a.webm", "vp9"), ("b.mp4", "av1")])
def test_a_turntable_is_a_video_that_players_open(ball_file, tmp_path, name, codec):
    path = tmp_path / name
    arguments = "--turntable", "0.5", "--fps", "8", "--size", "64x48", "--samples", "2"
    done = rendered(ball_file, *arguments, "--codec", codec, "-o", path)
    assert done.returncode == 0, done.stderr
    frames = frames_of(path)
    assert len(frames) == 4 and frames[0].shape == (48, 64, 3)
    assert abs(frames[0].astype(int) - frames[2]).max() > 30
    assert [p.name for p in tmp_path.iterdir()] == [name]
    assert "4 frames in" in done.stderr and "rendering" in done.stderr


@pytest.mark.gl
def test_a_transparent_film_shows_object_and_spheres_over_nothing(ball_file, tmp_path):
    """Put over white, it is the film that isn't transparent."""
    pictures = []
    for name, *options in (("clear", "--transparent"), ("white",)):
        arguments = "--turntable", "1", "--fps", "1", "--size", "96x64", "--samples", "4"
        done = rendered(ball_file, *arguments, *options, "-o", tmp_path / name)
        assert done.returncode == 0, done.stderr
        pictures.append(Image.open(tmp_path / name / "00000.png"))
    clear, white = pictures
    assert clear.mode == "RGBA" and clear.getpixel((0, 0))[3] == 0
    over = Image.new("RGBA", clear.size, "white")
    over.alpha_composite(clear)
    difference = np.asarray(over)[..., :3].astype(int) - np.asarray(white.convert("RGB"))
    assert abs(difference).max() <= 3
    opacity = np.asarray(clear)[..., 3]
    assert (opacity == 255).any() and ((opacity > 0) & (opacity < 255)).any()


@pytest.mark.gl
def test_a_path_films_a_pose(ball, ball_file, tmp_path, window):
    """The first frame is what a renderer shows of these vertices from the first key."""
    from deformrf.core.render import Renderer, from_field_of_view, look_at

    vertices = ball.mesh.rest_vertices * [1.0, 1.0, 0.8]
    np.save(tmp_path / "pose.npy", vertices)
    places = [[2.5, 0.0, 1.0], [0.0, 2.5, 1.0]]
    keys = [{"position": at, "target": [0.5, 0.5, 0.4], "fov": 40} for at in places]
    (tmp_path / "path.json").write_text(json.dumps({"keys": keys}))
    arguments = "--camera", tmp_path / "path.json", "--pose", tmp_path / "pose.npy"
    arguments += "--fps", "2", "--size", "64x64", "--hide-handles", "-o", tmp_path / "film"
    done = rendered(ball_file, *arguments)
    assert done.returncode == 0, done.stderr
    pictures = sorted((tmp_path / "film").iterdir())
    assert len(pictures) == 3
    renderer = Renderer(ball, "cpu")
    renderer.set_vertices(vertices.astype(np.float32))
    for picture, place in ((pictures[0], places[0]), (pictures[-1], places[1])):
        camera = from_field_of_view(look_at(place, [0.5, 0.5, 0.4]), np.radians(40), 64, 64)
        wanted = renderer.render(camera).color_array()[..., :3].astype(int)
        assert abs(np.asarray(Image.open(picture)).astype(int) - wanted).max() <= 2


@pytest.mark.gl
def test_a_film_along_a_data_set_shows_its_lens(ball, ball_file, tmp_path, window):
    """Two focal lengths, an axis beside the middle and distortion: as the renderer shows them."""
    from posed_data import write_frames

    from deformrf.core.render import Camera, Lens, Renderer, look_at

    numbers = {"fl_x": 70.0, "fl_y": 60.0, "cx": 30.0, "cy": 24.0, "w": 64, "h": 48, "k1": 0.1}
    poses = [look_at(at, [0.5, 0.5, 0.4]) for at in ([2.0, 0.0, 1.0], [0.0, 2.0, 1.0])]
    frames = [{"file_path": "gone", "transform_matrix": pose.tolist()} for pose in poses]
    path = write_frames(tmp_path / "data", frames, **numbers) / "transforms.json"
    arguments = "--camera", path, "--fps", "1", "--size", "64x48", "--hide-handles"
    assert rendered(ball_file, *arguments, "-o", tmp_path / "film").returncode == 0
    first, second = sorted((tmp_path / "film").iterdir())
    lens = Lens(64, 48, (70.0, 60.0), (30.0, 24.0), (0.1, 0.0, 0.0, 0.0))
    for picture, pose in ((first, poses[0]), (second, poses[1])):
        wanted = Renderer(ball, "cpu").render(Camera(pose, lens)).color_array()[..., :3].astype(int)
        assert abs(np.asarray(Image.open(picture)).astype(int) - wanted).max() <= 2


@pytest.mark.gl
def test_a_material_changes_how_a_session_moves_the_object(recorded, ball_file, tmp_path, window):
    last = []
    for name in ("default", "jelly"):
        arguments = "--session", recorded[1], "--material", name, "-o", tmp_path / name
        cut = "--from", "40", "--to", "40", "--size", "64x64", "--hide-handles"
        done = rendered(ball_file, *arguments, *cut)
        assert done.returncode == 0, done.stderr
        (picture,) = (tmp_path / name).iterdir()
        last.append(np.asarray(Image.open(picture)).astype(int))
    assert abs(last[0] - last[1]).max() > 10


@pytest.mark.gl
def test_strain_with_its_legend_and_the_ground_are_in_a_film(ball, ball_file, tmp_path):
    from deformrf.viewer.document import Scene
    from deformrf.viewer.layers.legend import COLORS

    scene = Scene(ball, "ball", "cpu")
    start = start_of(scene)
    scene.set_ground(True)
    scene.settings.mesh_surface, scene.settings.mesh_opacity = "strain", 1.0
    scene.clock.advance(0.05)
    path = save_session(scene, start, tmp_path / "s.jsonl")
    arguments = "--session", path, "--size", "160x120", "--fps", "20", "-o", tmp_path / "film"
    done = rendered(ball_file, *arguments)
    assert done.returncode == 0, done.stderr
    picture = np.asarray(Image.open(sorted((tmp_path / "film").iterdir())[-1])).astype(int)
    lowest, highest = 255 * COLORS["viridis"][[0, -1]]
    middle = picture[60, 80] / np.linalg.norm(picture[60, 80])
    assert middle @ lowest / np.linalg.norm(lowest) > 0.99  # no strain: dark violet
    assert (abs(picture[:, 110:] - highest).max(axis=-1) < 25).any()  # the legend's last color
    assert 150 < picture[-3, :20].mean() < 250 and (picture[3, :20] == 255).all()  # the ground


@pytest.mark.gl
def test_a_session_of_another_model_is_refused(recorded, tmp_path):
    from deformrf.core.base.paths import DEFAULT_MODEL

    done = rendered(DEFAULT_MODEL, "--session", recorded[1], "-o", tmp_path / "a.mp4")
    assert done.returncode == 2 and "a session of another model" in done.stderr
    assert not (tmp_path / "a.mp4").exists()
