"""Clips: what was pushed is what a player finds."""

import operator
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image, ImageSequence

from deformrf.viewer.films import CODECS, encoder
from deformrf.viewer.films import video as v


def gray(value, width=64, height=48):
    return np.full((height, width, 3), value, np.uint8)


def probe(path):
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)], stream


class Clock:
    """Seconds that pass when told to."""

    now = 0.0

    def __call__(self):
        return self.now


def test_every_pushed_frame_is_in_the_clip(tmp_path):
    video = v.VideoWriter(tmp_path / "a.mp4", (64, 48), 30)
    for k in range(45):
        video.push(gray(5 * k))
    assert video.close() == tmp_path / "a.mp4"
    frames, stream = probe(tmp_path / "a.mp4")
    assert len(frames) == 45
    assert stream.average_rate == 30
    assert float(stream.duration * stream.time_base) == pytest.approx(1.5)
    assert [round(frame.mean() / 5) for frame in frames] == list(range(45))
    assert list(tmp_path.iterdir()) == [tmp_path / "a.mp4"]


def test_the_clip_is_tagged_h264_yuv420p_bt709(tmp_path):
    video = v.VideoWriter(tmp_path / "a.mp4", (64, 48), 30)
    video.push(gray(100))
    video.close()
    _, stream = probe(tmp_path / "a.mp4")
    context = stream.codec_context
    assert context.name == "h264"
    assert context.pix_fmt == "yuv420p"
    tags = context.color_range, context.colorspace, context.color_primaries, context.color_trc
    assert tags == (1, 1, 1, 1)


def test_colors_survive(tmp_path):
    video = v.VideoWriter(tmp_path / "a.mp4", (64, 48), 30)
    red = gray(0)
    red[:] = 210, 40, 30
    for _ in range(3):
        video.push(red)
    video.close()
    frames, _ = probe(tmp_path / "a.mp4")
    assert abs(frames[1].reshape(-1, 3).mean(axis=0) - [210, 40, 30]).max() < 6


def test_an_odd_size_loses_one_row_and_column(tmp_path):
    video = v.VideoWriter(tmp_path / "a.mp4", (65, 49), 30)
    video.push(gray(9, 65, 49))
    video.close()
    frames, _ = probe(tmp_path / "a.mp4")
    assert frames[0].shape == (48, 64, 3)


def test_until_it_is_closed_the_clip_has_another_name(tmp_path):
    video = v.VideoWriter(tmp_path / "a.mp4", (64, 48), 30)
    video.push(gray(0))
    assert video.partial.name.startswith(".a-") and video.partial.name.endswith(".part.mp4")
    assert not (tmp_path / "a.mp4").exists()
    video.close()
    assert (tmp_path / "a.mp4").exists()
    assert not video.partial.exists()


def test_live_a_slow_picture_is_repeated_and_a_quick_one_left_out(tmp_path):
    clock = Clock()
    video = v.VideoWriter(tmp_path / "a.mp4", (64, 48), 10, clock=clock)
    for seconds, value in [(0.0, 10), (0.3, 60), (0.31, 110), (0.45, 160), (0.95, 210)]:
        clock.now = seconds
        video.push(gray(value))
    clock.now = 1.2
    video.close()
    frames, _ = probe(tmp_path / "a.mp4")
    levels = [round(frame.mean() / 50 - 0.2) for frame in frames]
    assert levels == [0, 0, 0, 2, 3, 3, 3, 3, 3, 4, 4, 4]
    assert (video.frame_count, video.dropped_count) == (12, 1)
    assert video.repeated_count == 12 - 4


def test_a_frame_is_due_when_its_time_has_come(tmp_path):
    clock = Clock()
    video = v.VideoWriter(tmp_path / "a.mp4", (64, 48), 10, clock=clock)
    assert video.due()
    video.push(gray(0))
    assert not video.due()
    clock.now = 0.1
    assert video.due()
    video.close()


def test_an_encoder_that_fails_says_so_and_leaves_no_file(tmp_path, monkeypatch):
    def broken(*_):
        raise ValueError("no such color")

    monkeypatch.setattr(v, "_video_frame", broken)
    video = v.VideoWriter(tmp_path / "a.mp4", (64, 48), 30)
    video.push(gray(0))
    with pytest.raises(RuntimeError, match="no such color"):
        video.close()
    assert list(tmp_path.iterdir()) == []


def half_shown(value):
    """A picture whose left part is opaque, its middle half so, and its right part is empty."""
    image = np.zeros((48, 64, 4), np.uint8)
    image[:, :24] = *value, 255
    image[:, 24:44, :3], image[:, 24:44, 3] = np.array(value) // 2, 128
    return image


@pytest.mark.parametrize("name", ["a.webm", "a.webp", "a"])
def test_a_transparent_film_keeps_color_and_opacity(tmp_path, name):
    path, greens = tmp_path / name, (40, 90, 140)  # WebP would join frames that are the same
    if path.suffix:
        video = v.VideoWriter(path, (64, 48), 10, transparent=True)
    else:
        video = v.PictureSeries(path, 10, transparent=True)
    for green in greens:
        video.push(half_shown((200, green, 30)))
    assert video.close() == path
    assert video.encoding_seconds > 0.0
    frames = transparent_frames(path)
    assert len(frames) == 3
    for frame, green in zip(frames, greens, strict=True):
        for column, opacity in ((8, 255), (34, 128), (58, 0)):
            assert abs(int(frame[20, column, 3]) - opacity) <= 3
            if opacity:
                assert abs(frame[20, column, :3].astype(int) - [200, green, 30]).max() <= 9


def transparent_frames(path):
    """Pictures [H, W, 4] with straight alpha, as players show them."""
    if path.is_dir():
        return [np.asarray(Image.open(picture)) for picture in sorted(path.iterdir())]
    if path.suffix == ".webp":
        file = Image.open(path)
        return [np.asarray(one.convert("RGBA")) for one in ImageSequence.Iterator(file)]
    decoder = av.CodecContext.create("libvpx-vp9", "r")  # FFmpeg's own skips the opacity
    with av.open(str(path)) as container:
        packets = list(container.demux(video=0))
        return [f.to_ndarray(format="rgba") for p in packets for f in decoder.decode(p)]


def test_colors_over_an_opacity_are_divided_by_it():
    opacity = np.arange(256)
    image = np.zeros((256, 1, 4), np.uint8)
    image[:, 0, 3] = opacity
    image[:, 0, 0], image[:, 0, 1] = opacity, np.round(0.4 * opacity)
    own = v.straight(image)
    assert (own[1:, 0, 0] == 255).all() and own[0, 0].tolist() == [0, 0, 0, 0]
    assert abs(own[64:, 0, 1].astype(float) - 102).max() <= 2
    assert np.array_equal(own[..., 3], image[..., 3])


@pytest.mark.parametrize("name, codec", [("a.mp4", "h264"), ("a.webm", "av1")])
def test_what_has_no_opacity_says_so(name, codec):
    with pytest.raises(ValueError, match=f"{codec} has no opacity; vp9 or webp"):
        encoder(Path(name), codec, transparent=True)


def test_an_encoder_that_is_missing_is_named(monkeypatch):
    lost = CODECS["av1"]._replace(name="libnothing")
    monkeypatch.setitem(CODECS, "av1", lost)
    with pytest.raises(ValueError, match=r"no encoder for av1 \(libnothing\)"):
        encoder(Path("a.mp4"), "av1")


def test_large_images_wait_in_small_numbers():
    assert v.waiting(400, 400) == v.QUEUE_LENGTH
    assert 2 <= v.waiting(7680, 4320) <= 3
    assert v.waiting(3840, 2160) * 3840 * 2160 * 4 <= v.QUEUE_BYTES


def test_a_frame_of_another_size_is_centered():
    image = gray(7, 4, 2)
    image[:, :, 0] = np.arange(4)
    assert v.fitted(image, 2, 4)[:, :, 0].tolist() == [[0, 0], [1, 2], [1, 2], [0, 0]]


@pytest.mark.parametrize("name", ["a.mp4", "a"])
@pytest.mark.parametrize("count", [0, 2])
def test_what_is_cut_short_says_so_in_its_name_and_is_nothing_without_a_frame(
    tmp_path, name, count
):
    path = tmp_path / name
    if path.suffix:
        path.write_text("an older film")
        (tmp_path / "a (cut short).mp4").write_text("another one")
        video = v.VideoWriter(path, (64, 48), 10)
    else:
        path.mkdir()
        video = v.PictureSeries(path, 10)
    before = sorted(tmp_path.iterdir())
    for _ in range(count):
        video.push(np.zeros((48, 64, 3), np.uint8))
    if not count:
        with pytest.raises(RuntimeError, match="no frame"):
            video.close(cut_short=True)
        assert set(tmp_path.iterdir()) <= set(before)
        return
    written = video.close(cut_short=True)
    expected = "a (cut short)-2.mp4" if path.suffix else "a (cut short)"
    assert written == tmp_path / expected and written.exists()
    assert path.read_text() == "an older film" if path.suffix else path.is_dir()
    assert not [one for one in tmp_path.iterdir() if ".part" in one.name]


@pytest.mark.parametrize("name", ["a.mp4", "a.webm", "a.webp"])
def test_a_video_without_a_frame_takes_nobody_s_place(tmp_path, name):
    """An interrupt may come before the first one."""
    path = tmp_path / name
    path.write_text("an older film")
    writer = v.VideoWriter(path, (64, 48), 30)
    with pytest.raises(RuntimeError, match="was not written: it would have no frame"):
        writer.close()
    assert path.read_text() == "an older film" and list(tmp_path.iterdir()) == [path]


CLOSING = [  # calls in close, of the module and of an object in it
    *(("a.mp4", call) for call in ("sync", "Path.replace", "threading.Thread.join")),
    *(("a", call) for call in ("Path.replace", "ThreadPoolExecutor.shutdown")),
]


@pytest.mark.parametrize("moment", ["before", "after"])
@pytest.mark.parametrize("name, call", CLOSING)
def test_an_interrupt_while_a_film_is_closed_loses_nothing(
    tmp_path, monkeypatch, name, call, moment
):
    """Who was interrupted closes it again, as what was cut short: it is whole, though."""
    path = tmp_path / name
    video = v.VideoWriter(path, (64, 48), 10) if path.suffix else v.PictureSeries(path, 10)
    for k in range(12):
        video.push(gray(20 * k))
    *owner, last = call.split(".")
    owner = operator.attrgetter(".".join(owner))(v) if owner else v
    real = getattr(owner, last)

    def interrupted(*arguments, **options):
        if moment == "after":
            real(*arguments, **options)
        monkeypatch.setattr(owner, last, real)
        raise KeyboardInterrupt

    monkeypatch.setattr(owner, last, interrupted)
    with pytest.raises(KeyboardInterrupt):
        video.close()
    assert video.close(cut_short=True) == path and list(tmp_path.iterdir()) == [path]
    assert len(probe(path)[0] if path.suffix else list(path.iterdir())) == 12


def test_an_interrupt_while_a_video_begins_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(av, "open", interrupted)
    with pytest.raises(KeyboardInterrupt):
        v.VideoWriter(tmp_path / "a.mp4", (64, 48), 30)
    assert list(tmp_path.iterdir()) == []


def test_a_film_is_written_behind_a_link(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    link, target = tmp_path / "a.mp4", tmp_path / "elsewhere" / "b.mp4"
    link.symlink_to(target)
    target.write_text("an older film")
    target.chmod(0o600)
    writer = v.VideoWriter(link, (64, 48), 30)
    writer.push(np.zeros((48, 64, 3), np.uint8))
    assert writer.close() == link and link.is_symlink()
    assert target.stat().st_mode & 0o777 == 0o600 and target.stat().st_size > 100
    assert list(target.parent.iterdir()) == [target]
