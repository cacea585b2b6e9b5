"""Clips: what was pushed is what a player finds."""

import av
import numpy as np
import pytest

from deformrf.viewer import video as v


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
    assert video.part.name == "a.part.mp4"
    assert not (tmp_path / "a.mp4").exists()
    video.close()
    assert (tmp_path / "a.mp4").exists()
    assert not video.part.exists()


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
    def broken(image):
        raise ValueError("no such color")

    monkeypatch.setattr(v, "_video_frame", broken)
    video = v.VideoWriter(tmp_path / "a.mp4", (64, 48), 30)
    video.push(gray(0))
    with pytest.raises(RuntimeError, match="no such color"):
        video.close()
    assert list(tmp_path.iterdir()) == []


def test_a_frame_of_another_size_is_centered():
    image = gray(7, 4, 2)
    image[:, :, 0] = np.arange(4)
    assert v.fitted(image, 2, 4)[:, :, 0].tolist() == [[0, 0], [1, 2], [1, 2], [0, 0]]
