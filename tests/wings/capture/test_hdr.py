"""HDR videos: frames become what sRGB shows, and other videos stay as they are."""

import io

import av
import numpy as np
import pytest
from PIL import Image

from deformrf.wings.capture import CaptureError, frames_of_video, hdr, video

FROM_BT709 = np.linalg.inv(hdr.BT2020)
CELL, ROWS, COLUMNS = 16, 4, 6


def to_pq(light):
    """SMPTE ST 2084's signal of light [cd/m²]."""
    m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
    power = (np.asarray(light) / 10_000.0) ** m1
    return ((c1 + c2 * power) / (1.0 + c3 * power)) ** m2


def to_hlg(light):
    """ARIB STD-B67's signal of light on a screen of 1000 cd/m²."""
    shown = np.asarray(light) / 1000.0
    luminance = shown @ [0.2627, 0.6780, 0.0593]
    scene = shown * np.maximum(luminance, 1e-9)[..., None] ** (1 / 1.2 - 1.0)
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(scene <= 1 / 12, np.sqrt(3.0 * scene), a * np.log(12.0 * scene - b) + c)


SIGNALS = {hdr.PQ: to_pq, hdr.HLG: to_hlg}


def cells():
    """Linear colors of BT.709 that the tone curve leaves alone.  [ROWS, COLUMNS, 3]"""
    colors = np.random.default_rng().uniform(0.02, hdr.KNEE, (ROWS, COLUMNS, 3))
    colors[0] = np.linspace(0.02, hdr.KNEE, COLUMNS)[:, None]  # grays
    return colors


def frame_of(signal, trc, full=False, space=9, primaries=9):
    """A 10-bit frame with cells of signals r, g, b.  [ROWS, COLUMNS, 3]"""
    big = np.kron(signal, np.ones((CELL, CELL, 1)))
    y = big @ [0.2627, 0.6780, 0.0593]
    blue, red = (big[..., 2] - y) / 1.8814, (big[..., 0] - y) / 1.4746
    scale, low, wide = (1023, 0, 1023) if full else (876, 64, 896)
    planes = y * scale + low, (blue * wide + 512)[::2, ::2], (red * wide + 512)[::2, ::2]
    frame = av.VideoFrame(*y.shape[::-1], "yuv420p10le")
    for plane, values in zip(frame.planes, planes, strict=True):
        rows = np.zeros((plane.height, plane.line_size // 2), "<u2")
        rows[:, : values.shape[1]] = np.clip(np.round(values), 0, 1023)
        plane.update(rows.tobytes())
    frame.color_trc, frame.colorspace, frame.color_primaries = trc, space, primaries
    frame.color_range = 2 if full else 1
    return frame


def write(path, frame, codec="libx265", count=3):
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt = frame.width, frame.height, "yuv420p10le"
        stream.options = {"crf": "4", "x265-params": "log-level=none"}
        context = stream.codec_context
        context.color_trc, context.colorspace = frame.color_trc, frame.colorspace
        context.color_primaries, context.color_range = frame.color_primaries, frame.color_range
        for number in range(count):
            frame.pts = number
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode(None):
            container.mux(packet)


def middles(pixels):
    return np.asarray(pixels)[CELL // 2 :: CELL, CELL // 2 :: CELL].astype(float)


def test_signals_are_those_of_the_standards():
    light = np.geomspace(0.01, 10_000.0, 50)
    assert hdr.from_pq(to_pq(light)) == pytest.approx(light, rel=1e-5)
    colors = np.random.default_rng().uniform(0.1, 1000.0, (50, 3))
    colors *= 1000.0 / np.maximum(colors.max(axis=1, keepdims=True), 1000.0)
    assert hdr.from_hlg(to_hlg(colors)) == pytest.approx(colors, rel=1e-4)
    # BT.2408: paper is at 58 % of PQ, and at 75 % of HLG.
    assert hdr.from_pq(np.float64(0.5807)) == pytest.approx(hdr.WHITE, rel=0.01)
    assert hdr.from_hlg(np.full((1, 3), 0.75)) == pytest.approx(hdr.WHITE, rel=0.01)
    assert np.sum(hdr.BT2020, axis=1) == pytest.approx(1.0, abs=1e-5)
    assert np.sum(hdr.P3, axis=1) == pytest.approx(1.0, abs=1e-5)


def test_the_tone_curve_is_smooth_and_ends_at_1():
    x = np.linspace(0.0, 60.0, 60_001)
    y = hdr.pressed(x)
    assert (
        (np.diff(y) >= 0.0).all()
        and y[-1] <= 1.0
        and y[x <= hdr.KNEE] == pytest.approx(x[x <= hdr.KNEE])
    )
    assert np.abs(np.diff(y, 2)).max() < 1e-5, "no corner"


@pytest.mark.parametrize("trc", SIGNALS)
@pytest.mark.parametrize("full", [False, True])
def test_colors_below_the_knee_come_back(trc, full):
    colors = cells()
    frame = frame_of(SIGNALS[trc](hdr.WHITE * colors @ FROM_BT709.T), trc, full)
    found = middles(hdr.standard(frame, (frame.width, frame.height)))
    assert np.abs(found - 255.0 * hdr.srgb(colors)).max() <= 2.0
    small = hdr.standard(frame, (frame.width // 2, frame.height // 2))
    assert small.shape == (ROWS * CELL // 2, COLUMNS * CELL // 2, 3)


@pytest.mark.parametrize("trc", SIGNALS)
def test_what_is_bright_keeps_its_hue(trc):
    """All three are pressed alike; without that, a bright orange becomes yellow."""
    color = np.array([4.0, 2.0, 1.0])
    light = np.broadcast_to(hdr.WHITE * color @ FROM_BT709.T, (ROWS, COLUMNS, 3))
    frame = frame_of(SIGNALS[trc](light), trc)
    shown = middles(hdr.standard(frame, (frame.width, frame.height)))[0, 0] / 255.0
    linear = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    assert linear[0] > 0.95
    assert linear / linear[0] == pytest.approx(color / color[0], abs=0.02)


@pytest.mark.parametrize(("trc", "ending"), [(hdr.PQ, "mp4"), (hdr.HLG, "mov"), (hdr.HLG, "mkv")])
def test_frames_of_an_hdr_video_are_photographs(tmp_path, trc, ending):
    colors = cells()
    path = tmp_path / f"phone.{ending}"
    frame = frame_of(SIGNALS[trc](hdr.WHITE * colors @ FROM_BT709.T), trc)
    write(path, frame)
    folder = frames_of_video(path)
    wanted = 255.0 * hdr.srgb(colors)
    with Image.open(min(folder.glob("*.jpg"))) as image:
        assert np.abs(middles(image) - wanted).mean() < 3.0
    plain = middles(frame.to_ndarray(format="rgb24"))
    assert np.abs(plain - wanted).mean() > 10.0, "a plain decoder shows something else"


@pytest.mark.parametrize("trc", [1, 2, 14])
def test_other_videos_are_what_they_were(tmp_path, trc):
    """Also those of 10 bits in BT.2020's colors."""
    frame = frame_of(np.random.default_rng().random((ROWS, COLUMNS, 3)), trc)
    write(tmp_path / "a.mkv", frame, "ffv1", count=1)
    folder = frames_of_video(tmp_path / "a.mkv", image_size=80)
    (decoded,) = video.frames_of(tmp_path / "a.mkv", lambda share: None)
    image = Image.fromarray(decoded.to_ndarray(format="rgb24"))
    file = io.BytesIO()
    image.resize((80, 53), Image.Resampling.BOX).save(file, "JPEG", quality=95, subsampling=0)
    assert (folder / "000000.jpg").read_bytes() == file.getvalue()


@pytest.mark.parametrize("space", [8, 10, 14])
def test_colors_that_ffmpeg_can_not_convert_end_in_a_sentence(tmp_path, space):
    """Not in HDR; where FFmpeg can, there are frames."""
    frame = frame_of(np.full((ROWS, COLUMNS, 3), 0.5), 1, space=space)
    write(tmp_path / "a.mkv", frame, "ffv1", count=2)
    try:
        assert len(list(frames_of_video(tmp_path / "a.mkv").glob("*.jpg"))) == 2
    except CaptureError as error:
        assert str(error).startswith(f"{tmp_path / 'a.mkv'} has frames that can't be converted")


@pytest.mark.parametrize(("space", "primaries"), [(14, 9), (10, 9), (9, 22)])
def test_colors_that_nobody_can_convert_are_refused(tmp_path, space, primaries):
    frame = frame_of(np.full((ROWS, COLUMNS, 3), 0.5), hdr.PQ, space=space, primaries=primaries)
    write(tmp_path / "a.mkv", frame, "ffv1", count=2)
    with pytest.raises(CaptureError, match=r"a\.mkv is an HDR video in colors that") as caught:
        frames_of_video(tmp_path / "a.mkv")
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mkv"]
