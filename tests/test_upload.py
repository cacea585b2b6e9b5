"""How images reach OpenGL."""

import numpy as np
import pytest
import warp as wp

from deformrf.core.render.render import Image
from deformrf.viewer.layers import upload

pytestmark = pytest.mark.gl


def image(rows, width, device, seed=0):
    rng = np.random.default_rng(seed)
    color = rng.integers(0, 255, (rows, width, 4), np.uint8)
    depth = rng.uniform(0, 3, (rows, width)).astype(np.float32)
    depth[0, 0] = np.inf
    return Image(wp.array(color, dtype=wp.vec4ub, device=device), wp.array(depth, device=device), 0)


def read(texture, dtype):
    return np.frombuffer(texture.read(), dtype).reshape(texture.height, texture.width, -1)


@pytest.mark.parametrize("wanted", ["auto", "copy"])
def test_on_the_cpu_frames_are_copied(window, wanted):
    assert upload.choose_path(window[1], "cpu", wanted) == "copy"


def test_what_cannot_be_shared_is_refused_in_a_sentence(window):
    with pytest.raises(ValueError, match="share no buffers here"):
        upload.choose_path(window[1], "cpu", "buffer")


@pytest.mark.parametrize("path", ["copy", "buffer"])
def test_strips_arrive_in_their_rows(window, device, path):
    try:
        assert upload.choose_path(window[1], device, path) == path
    except ValueError as error:
        pytest.skip(str(error))
    texture = upload.ImageTexture(window[1], (6, 7), device, path)
    top, bottom = image(4, 6, device), image(3, 6, device, seed=1)
    texture.write(top)
    texture.write(bottom, first_row=4)
    color, depth = read(texture.color, np.uint8), read(texture.depth, np.float32)[..., 0]
    assert np.array_equal(color, np.concatenate([top.color_array(), bottom.color_array()]))
    assert np.array_equal(depth, np.concatenate([top.depth_array(), bottom.depth_array()]))
    assert window[1].error == "GL_NO_ERROR"


def test_a_probe_that_fails_falls_back_to_copying(window, monkeypatch, caplog):
    class NoSharing:
        is_cuda = True

    monkeypatch.setattr(upload.wp, "get_device", lambda name: NoSharing)

    def broken(context, device):
        raise RuntimeError("error 304")

    monkeypatch.setattr(upload, "_probe", broken)
    assert upload.choose_path(window[1], "cuda:0", "auto") == "copy"
    assert "error 304" in caplog.text
