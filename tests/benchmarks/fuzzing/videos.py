"""Videos: containers that are cut and damaged where boxes and elements begin, and HDR tags."""

import struct

import av
import numpy as np

from deformrf.wings.capture import CaptureError, frames_of_video

from .damage import Binary, with_bytes, with_structure

FRAMES, SIDE = 12, 32
TRANSFERS = {"sdr": 1, "pq": 16, "hlg": 18, "linear": 8, "log": 9}
CONTAINERS = [("mp4", "libx264"), ("mov", "libx264"), ("mkv", "libx264"), ("webm", "libvpx-vp9")]
CONTAINERS += [("avi", "mpeg4"), ("mts", "libx264")]
BOXES = (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"edts", b"udta")


def video_bytes(path, codec, transfer=1, turn=0) -> bytes:
    """A small video whose picture moves."""
    rng = np.random.default_rng(0)
    wide = rng.integers(0, 256, (SIDE, SIDE + FRAMES * 2, 3)).astype(np.uint8)
    form = "mpegts" if path.suffix == ".mts" else None
    with av.open(str(path), "w", format=form) as container:
        stream = container.add_stream(codec, rate=30)
        stream.width = stream.height = SIDE
        stream.pix_fmt = "yuv420p"
        if turn:
            stream.set_display_rotation(turn)
        if transfer != 1:
            stream.codec_context.color_trc = transfer
            stream.codec_context.color_primaries = 9
            stream.codec_context.colorspace = 9
        for i in range(FRAMES):
            picture = np.ascontiguousarray(wide[:, 2 * i : 2 * i + SIDE])
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            if transfer != 1:
                frame.color_trc = transfer
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path.read_bytes()


def boxes(data, first=0, last=None):
    """Where the boxes of an MP4 begin, all in all."""
    last = len(data) if last is None else last
    while first + 8 <= last:
        size, name = struct.unpack_from(">I4s", data, first)
        yield first
        if size < 8:
            return
        if name in BOXES:
            yield from boxes(data, first + 8, min(first + size, last))
        first += size


def with_structure_of(data, ending) -> Binary:
    """The places of counts in a container."""
    if ending in ("mp4", "mov"):
        places = sorted(set(boxes(data)))
        counts = [(at, ">I") for at in places]
        counts += [
            (at + k, ">I") for at in places for k in (12, 16, 20, 24) if at + k + 4 <= len(data)
        ]
        return Binary(data, tuple(counts), tuple(places))
    parts = tuple(range(0, len(data), 188 if ending == "mts" else 97))
    counts = tuple((at, ">I") for at in range(0, min(len(data) - 4, 600), 3))
    return Binary(data, counts, parts)


class Videos:
    """A dozen frames in each container, and with the tags of HDR and of turned phones."""

    errors = (CaptureError,)

    def __init__(self, folder):
        self.wholes = {}
        for ending, codec in CONTAINERS:
            path = folder / f"a.{ending}"
            self.wholes[path.name] = with_structure_of(video_bytes(path, codec), ending)
        for name, transfer in TRANSFERS.items():
            path = folder / f"{name}.mp4"
            turn = 90 if name == "hlg" else 0
            data = video_bytes(path, "libx264", transfer, turn)
            self.wholes[path.name] = with_structure_of(data, "mp4")

    def original(self, folder):
        (folder / "a.mp4").write_bytes(self.wholes["a.mp4"].data)

    def mutate(self, rng, folder):
        name = list(self.wholes)[rng.integers(len(self.wholes))]
        whole = self.wholes[name]
        other = self.wholes[list(self.wholes)[rng.integers(len(self.wholes))]].data
        data, what = whole.data, "whole"
        for _ in range(int(rng.integers(1, 3))):
            if rng.random() < 0.7 and data is whole.data:
                data, what = with_structure(rng, whole, other)
            else:
                data, what = with_bytes(rng, data), "bytes"
        if rng.random() < 0.05:
            name = f"b.{['mp4', 'webm', 'avi'][rng.integers(3)]}"  # another ending
        (folder / name).write_bytes(data)
        return f"{name}: {what}"

    def read(self, folder):
        path = next(p for p in folder.iterdir() if p.is_file())
        frames_of_video(path, 16, 4)
