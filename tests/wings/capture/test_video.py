"""Videos as photographs: which frames are taken, and what is refused."""

import subprocess
import sys

import av
import numpy as np
import pytest
from captures import circle, write_capture
from PIL import Image, ImageFilter

from deformrf.commands import train
from deformrf.core.training import sharpness_of
from deformrf.wings.capture import CaptureError, frames_of_video, video


def picture(rng, width=400, height=120):
    coarse = rng.integers(0, 256, (height // 3, width // 3, 3)).astype(np.uint8)
    return Image.fromarray(coarse).resize((width, height), Image.Resampling.NEAREST)


def write_video(path, frames, turn=0, title=""):
    """`turn`: degrees that a player turns them by, counterclockwise."""
    with av.open(str(path), "w") as container:
        container.metadata["title"] = title
        stream = container.add_stream("libx264", rate=30)
        if turn:
            stream.set_display_rotation(turn)
        stream.width, stream.height, stream.pix_fmt = *frames[0].size, "yuv420p"
        stream.options = {"crf": "12"}
        for frame in [*map(av.VideoFrame.from_image, frames), None]:
            for packet in stream.encode(frame):
                container.mux(packet)


def test_blur_lowers_sharpness_and_exposure_does_not():
    image = picture(np.random.default_rng()).convert("L")
    sharp = [sharpness_of(np.asarray(image.filter(ImageFilter.GaussianBlur(r)))) for r in range(4)]
    assert sharp == sorted(sharp, reverse=True) and sharp[1] < 0.9 * sharp[0]
    darker = np.asarray(image) // 2
    assert sharpness_of(darker) == pytest.approx(sharp[0], rel=0.02)
    assert sharpness_of(np.full((60, 80), 200, np.uint8)) == 0.0


def test_sharp_frames_are_taken_evenly_along_the_way(tmp_path):
    """The camera rests for half of the video, then pans; every second frame is blurred."""
    wide = picture(np.random.default_rng())
    frames = [wide.crop((0, 0, 160, 120))] * 30
    frames += [wide.crop((4 * i, 0, 4 * i + 160, 120)) for i in range(30)]
    frames = [f.filter(ImageFilter.GaussianBlur(2)) if i % 2 else f for i, f in enumerate(frames)]
    write_video(tmp_path / "pan.mp4", frames)
    folder = frames_of_video(tmp_path / "pan.mp4", 80, count=12)
    numbers = [int(path.stem) for path in sorted(folder.glob("*.jpg"))]
    assert all(n % 2 == 0 for n in numbers), "sharp ones"
    assert len(numbers) >= 10 and sum(n < 30 for n in numbers) <= len(numbers) // 2 + 1
    with Image.open(folder / f"{numbers[0]:06d}.jpg") as image:
        assert image.size == (80, 60)
    assert frames_of_video(tmp_path / "pan.mp4") == folder, "they are there already"
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]


def test_each_part_of_the_way_gives_its_sharpest_frame():
    rng = np.random.default_rng()
    way, sharpness = np.cumsum(rng.random(200) * (np.arange(200) < 150)), rng.random(200)
    chosen = video.chosen_frames(sharpness, way, 20)
    assert len(chosen) == 20 and chosen == sorted(chosen)
    steps = np.diff(way[chosen])
    assert steps.max() < 2.1 * way[-1] / 20
    assert video.chosen_frames(sharpness[:5], way[:5], 20) == list(range(5))
    assert len(video.chosen_frames(sharpness, np.zeros(200), 20)) == 20


def test_what_is_no_video_ends_in_one_sentence(tmp_path):
    (tmp_path / "a.mp4").write_text("no video")
    # A playlist names other files, and would be read under any ending.
    (tmp_path / "b.mp4").write_text("#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nc.mp4\n")
    for name in "ab":
        with pytest.raises(CaptureError, match="can't be read as a video") as caught:
            frames_of_video(tmp_path / f"{name}.mp4")
        assert "\n" not in str(caught.value)
    write_video(tmp_path / "c.mp4", [Image.new("RGB", (64, 48))] * 3)
    (tmp_path / "c-frames").mkdir()
    with pytest.raises(CaptureError, match="something else is there"):
        frames_of_video(tmp_path / "c.mp4")


def test_a_codec_that_nobody_knows_ends_in_one_sentence(tmp_path):
    write_video(tmp_path / "a.mp4", [Image.new("RGB", (64, 48))] * 3)
    content = (tmp_path / "a.mp4").read_bytes()
    assert content.count(b"avc1") >= 1
    (tmp_path / "a.mp4").write_bytes(content.replace(b"avc1", b"qqq1"))
    with pytest.raises(CaptureError, match="in a format that FFmpeg doesn't know"):
        frames_of_video(tmp_path / "a.mp4")


def test_what_a_video_says_of_itself_may_be_no_unicode(tmp_path):
    write_video(tmp_path / "a.mkv", [Image.new("RGB", (64, 48))] * 3, title="AAAABBBB")
    content = (tmp_path / "a.mkv").read_bytes()
    assert b"AAAABBBB" in content
    (tmp_path / "a.mkv").write_bytes(content.replace(b"AAAABBBB", b"AA\xff\xfeBBBB"[:8]))
    assert len(list(frames_of_video(tmp_path / "a.mkv").glob("*.jpg"))) >= 1


def test_a_stream_that_begins_later_ends_the_video(tmp_path):
    """PyAV doesn't know its number: what came before is used."""
    noise = np.random.default_rng().integers(0, 256, (240, 320, 3), np.uint8)
    for name, streams in (("first", 1), ("second", 3)):
        with av.open(str(tmp_path / f"{name}.mts"), "w", format="mpegts") as container:
            made = [container.add_stream("libx264", rate=30) for _ in range(streams)]
            for stream in made:
                stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
                stream.options = {"crf": "12", "preset": "ultrafast"}
            for shift in range(12):
                for stream in made:
                    image = np.roll(noise, 37 * shift, axis=0)
                    container.mux(stream.encode(av.VideoFrame.from_ndarray(image)))
            for stream in made:
                container.mux(stream.encode(None))
    parts = [(tmp_path / f"{name}.mts").read_bytes() for name in ("first", "second")]
    looked_at = 5_000_000  # bytes in which FFmpeg looks for streams
    (tmp_path / "a.mts").write_bytes(parts[0] * (looked_at // len(parts[0]) + 2) + parts[1])
    assert len(list(frames_of_video(tmp_path / "a.mts").glob("*.jpg"))) >= 1


def test_training_starts_with_a_video(call, trainer, tmp_path):
    """Its frames and their cameras lie beside it, and are there for the next run."""
    write_capture(tmp_path / "photos", circle(16), np.random.default_rng(7))
    frames = [Image.open(path) for path in sorted((tmp_path / "photos").iterdir())]
    write_video(tmp_path / "toy.mp4", frames)
    flags = (tmp_path / "toy.mp4", "-o", tmp_path / "m.npz", "--device", "cpu")
    result = call(train.main, *flags, "--scene-radius", 1)
    assert result.code == 0, result.err
    assert "cameras of 16 of 16" in result.out and trainer.calls[0][0].view_count == 14
    again = call(train.main, *flags, "--scene-radius", 1)
    assert again.code == 0 and "cameras of" not in again.out
    assert (tmp_path / "toy-frames" / "transforms.json").is_file()


@pytest.mark.parametrize("turn", [90, 180, -90])
def test_videos_of_a_telephone_that_was_held_upright_are_turned(tmp_path, turn):
    """The frames are stored lying, with the angle to turn them by beside them."""
    image = picture(np.random.default_rng(), 96, 120).filter(ImageFilter.GaussianBlur(2))
    stored = image.rotate(-turn, expand=True)
    write_video(tmp_path / "a.mp4", [stored] * 3, turn)
    folder = frames_of_video(tmp_path / "a.mp4", 400, count=1)
    (path,) = folder.glob("*.jpg")
    with Image.open(path) as frame:
        assert frame.size == (96, 120)
        assert np.abs(np.asarray(frame, float) - np.asarray(image, float)).mean() < 12


def test_asking_what_is_a_video_loads_no_library_for_it(tmp_path):
    program = (
        "import sys; from pathlib import Path; from deformrf.wings.capture import is_video;"
        "print(is_video(Path('model.npz')), 'av.container' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stdout.split() == ["False", "False"], run.stderr
