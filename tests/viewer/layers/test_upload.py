"""How images reach OpenGL."""

import numpy as np
import pytest
import warp as wp

from deformrf.core.render import Image
from deformrf.viewer.layers import gl, upload

pytestmark = pytest.mark.gl


def image(rows, width, device, seed=0):
    rng = np.random.default_rng(seed)
    color = rng.integers(0, 255, (rows, width, 4), np.uint8)
    depth = rng.uniform(0, 3, (rows, width)).astype(np.float32)
    depth[0, 0] = np.inf
    return Image(wp.array(color, dtype=wp.vec4ub, device=device), wp.array(depth, device=device), 0)


class HostWritten(upload.SharedImage):
    """A buffer that the host writes, as CUDA does where there is one."""

    def _register(self):
        pass

    def _write(self, arrays, first_row):
        for index, array in enumerate(arrays):
            start = index * self._byte_count + 4 * first_row * self.size[0]
            self._buffer.write(array.numpy().tobytes(), offset=start)


def drawn(context, target, defines=()):
    """What the shader shows of an image, and the depth that others hide behind.

    [h, w, 4] uint8, [h, w] float32
    """
    width, height = target.size
    framebuffer = context.framebuffer(
        [context.texture((width, height), 4)], context.depth_renderbuffer((width, height))
    )
    framebuffer.use()
    defines += ("BUFFER",) if target.is_buffer else ()
    triangle = gl.full_screen(context, "image", defines)
    gl.set_uniforms(
        triangle.program, field_color=0, field_depth=1, field_size=target.size, texel=0.1,
        extent=(1.0, 1.0), axis=(0.5, 0.5), depth_terms=(1.0, -1.0), transparent=True,
    )  # fmt: skip
    target.use()
    context.enable_only(context.DEPTH_TEST)
    context.depth_func = "1"
    triangle.render()
    context.depth_func = "<="
    assert context.error == "GL_NO_ERROR"
    colors = np.frombuffer(framebuffer.read(components=4), np.uint8).reshape(height, width, 4)
    raw = framebuffer.read(attachment=-1, components=1, dtype="f4", alignment=1)
    return colors[::-1], np.frombuffer(raw, np.float32).reshape(height, width)[::-1]


@pytest.mark.parametrize("wanted", ["auto", "copy"])
def test_on_the_cpu_frames_are_copied(window, wanted):
    assert upload.choose_path(window[1], "cpu", wanted) == "copy"


def test_what_cannot_be_shared_is_refused_in_a_sentence(window):
    with pytest.raises(ValueError, match="share no buffers here"):
        upload.choose_path(window[1], "cpu", "buffer")


@pytest.mark.parametrize("path", ["copy", "buffer", "written by the host"])
def test_strips_arrive_in_their_rows(window, device, path):
    """As the shader reads them; what is in a row stays when others are written."""
    context = window[1]
    if path == "written by the host":
        target = HostWritten(context, (6, 7), "cpu")
    else:
        try:
            assert upload.choose_path(context, device, path) == path
        except ValueError as error:
            pytest.skip(str(error))
        target = upload.image_target(context, (6, 7), device, path)
    top, bottom, colors = (image(n, 6, device, seed) for seed, n in enumerate((4, 3, 2)))
    target.prepare()
    target.write(top)
    target.write(bottom, first_row=4)
    target.prepare()
    target.prepare()  # the second time nothing is left to prepare
    target.write_color(colors.color, first_row=3)
    target.prepare()  # and no image comes before it is drawn
    wanted = np.concatenate([i.color_array() for i in (top, bottom)])
    wanted[3:5] = colors.color_array()
    assert np.array_equal(drawn(context, target)[0], wanted)
    depth = np.concatenate([i.depth_array() for i in (top, bottom)])
    if path == "copy":
        assert target.depth.read() == depth.tobytes()
    else:
        assert target.read() == wanted.tobytes() + depth.tobytes()
    target.release()
    assert context.error == "GL_NO_ERROR"


@pytest.mark.parametrize("defines", [(), ("SMOOTH",)])
def test_a_buffer_is_drawn_as_textures_are(window, defines):
    context, size = window[1], (13, 9)
    frame = image(9, 13, "cpu", 5)
    both = HostWritten(context, size, "cpu"), upload.ImageTexture(context, size)
    for target in both:
        target.write(frame)
    buffer, textures = (drawn(context, target, defines) for target in both)
    for one, other in zip(buffer, textures, strict=True):
        assert np.array_equal(one, other) and len(np.unique(one)) > 50


def test_others_hide_behind_what_a_buffer_shows(window):
    """The depth 1 - 1/z, at a distance z before the camera's plane; beyond 1 is nothing."""
    frame = image(9, 13, "cpu", 5)
    target = HostWritten(window[1], (13, 9), "cpu")
    target.write(frame)
    x, y = ((np.arange(n) + 0.5) / n - 0.5 for n in (13, 9))
    z = frame.depth_array() / np.sqrt(1.0 + x**2 + y[:, None] ** 2)
    wanted = np.clip(1.0 - 1.0 / z, 0.0, 1.0)
    np.testing.assert_allclose(drawn(window[1], target)[1], wanted, atol=1e-6)


def test_a_probe_that_fails_falls_back_to_copying(window, monkeypatch, caplog):
    class NoSharing:
        is_cuda = True

    monkeypatch.setattr(upload.wp, "get_device", lambda name: NoSharing)

    def broken(context, device):
        raise RuntimeError("error 304")

    monkeypatch.setattr(upload, "_probe", broken)
    assert upload.choose_path(window[1], "cuda:0", "auto") == "copy"
    assert "error 304" in caplog.text
