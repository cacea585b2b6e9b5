"""Films of clips: deformrf render --clip."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.commands import render as render_command
from deformrf.viewer.document import Scene, SessionError
from deformrf.viewer.films import Film, clip_session
from deformrf.wings import rig


@pytest.fixture(scope="module")
def dancer(ball):
    """The ball with two bones and a clip of half a second that ends where it begins."""
    skeleton = rig.make_skeleton(
        ["low", "high"],
        [-1, 0],
        [[0.5, 0.5, 0.1], [0.5, 0.5, 0.5]],
        [[0.5, 0.5, 0.5], [0.5, 0.5, 0.9]],
    )
    rest = skeleton.rest_pose
    bent = rig.turned(skeleton, rest, 1, (0.8, 0.0, 0.0))
    clip = rig.clip_of_poses("Dance", [0.0, 0.25, 0.5], [rest, bent, rest])
    made = rig.Rig(skeleton, rig.automatic_weights(ball.mesh, skeleton), (clip,))
    return replace(ball, rig_arrays=rig.arrays_of(made))


@pytest.fixture(scope="module")
def dancer_file(dancer, tmp_path_factory):
    from deformrf.core.field import save

    path = tmp_path_factory.mktemp("model") / "dancer.npz"
    save(dancer, path)
    return path


def poses_of(film, count):
    """The vertices of all frames.  [count, V, 3]"""
    found = []
    for frame in range(count):
        film.show(frame)
        found.append(film.scene.positions.copy())
    return np.array(found)


def test_a_film_of_a_clip_goes_round_without_a_jump(dancer):
    scene = Scene(dancer, "dancer", "cpu")
    session, begin, seconds = clip_session(scene.rigging, "Dance", 0.0, 1.0)
    assert (begin, seconds) == (0, 1.0)
    poses = poses_of(Film(scene, session, 30), 30)
    np.testing.assert_allclose(poses[15:], poses[:15], atol=1e-5)
    steps = abs(np.diff(poses, axis=0)).max(axis=(1, 2))
    assert steps.max() < 2.0 * np.median(steps)


def test_a_soft_clip_is_on_its_way_when_the_film_begins(dancer):
    scene = Scene(dancer, "dancer", "cpu")
    session, begin, seconds = clip_session(scene.rigging, "Dance", 0.7, None)
    assert (begin, seconds) == (30, 0.5)
    film = Film(scene, session, 30)
    film.cut(begin, None)
    film.show(0)
    assert scene.posing.playing and not scene.clock.paused
    assert abs(scene.positions - dancer.mesh.rest_vertices).max() > 1e-3


def test_a_clip_that_is_not_there_is_named(dancer, ball):
    with pytest.raises(SessionError, match="no clip 'Run': its clips are Dance"):
        clip_session(Scene(dancer, "dancer", "cpu").rigging, "Run", 0.0, None)
    with pytest.raises(SessionError, match="no clip 'Run': it has none"):
        clip_session(Scene(ball, "ball", "cpu").rigging, "Run", 0.0, None)


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        (["--clip", "Run"], "no clip 'Run': its clips are Dance"),
        (["--clip", "Dance", "--softness", "2"], "--softness is 2"),
        (["--turntable", "1", "--softness", "0.5"], "it needs --clip"),
        (["--clip", "Dance", "--session", "s.jsonl"], "leave --session and --pose out"),
        (["--clip", "Dance", "--pose", "p.npy"], "leave --session and --pose out"),
        (
            ["--session", "a.jsonl", "--show-handles"],
            "--show-handles is for films without a --session",
        ),
        (["--clip", "Dance", "--show-handles", "--hide-handles"], "leave it out"),
    ],
)
@pytest.mark.gl
def test_what_makes_no_sense_is_explained(dancer_file, tmp_path, capfd, arguments, sentence):
    path = tmp_path / "a.mp4"
    whole = [str(dancer_file), "-o", str(path), "--size", "64x48", "--device", "cpu", *arguments]
    assert render_command.main(whole) == 2
    lines = capfd.readouterr().err.splitlines()  # a slow start is told of before
    assert sentence in lines[-1] and not any("Traceback" in line for line in lines)
    assert not path.exists()


@pytest.mark.gl
@pytest.mark.parametrize(
    "arguments, count", [([], 5), (["--turntable", "1"], 10), (["--frames", "7"], 7)]
)
def test_a_film_lasts_as_long_as_the_clip_or_as_it_is_told(dancer_file, tmp_path, arguments, count):
    from PIL import Image

    folder = tmp_path / "frames"
    size = ["--size", "64x48", "--fps", "10", "--device", "cpu"]
    assert (
        render_command.main(
            [str(dancer_file), "--clip", "Dance", "-o", str(folder), *size, *arguments]
        )
        == 0
    )
    frames = [np.asarray(Image.open(path)) for path in sorted(folder.iterdir())]
    assert len(frames) == count
    assert (frames[0] != frames[2]).any()


@pytest.mark.gl
def test_handles_are_drawn_with_a_clip_only_if_they_are_asked_for(dancer_file, tmp_path):
    from PIL import Image

    def red(*arguments):
        """Pixels of the first frame that are as red as a control point."""
        folder = tmp_path / f"frames{len(list(tmp_path.iterdir()))}"
        whole = [str(dancer_file), "--clip", "Dance", "-o", str(folder), "--size", "160x120"]
        whole += ["--frames", "1", "--device", "cpu", *arguments]
        assert render_command.main(whole) == 0
        with Image.open(next(folder.iterdir())) as image:
            r, g, b = np.moveaxis(np.asarray(image.convert("RGB"), int), 2, 0)
        return int(((r > 150) & (g < 90) & (b < 90)).sum())

    assert red("--show-handles") > red() + 50
    assert red() == red("--hide-handles")
