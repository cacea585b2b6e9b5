"""Which of FFmpeg's encoders writes which file."""

from pathlib import Path
from typing import NamedTuple


class Encoder(NamedTuple):
    """One of FFmpeg's encoders."""

    name: str
    options: dict
    endings: tuple[str, ...]  # of files that hold its video
    pixels: str = "yuv420p"
    transparent: str = ""  # pixels that have an opacity, if it knows any


CODECS = {  # as a user calls them
    "h264": Encoder("libx264", {"crf": "18", "preset": "veryfast"}, (".mp4",)),
    "h265": Encoder(
        "libx265", {"crf": "20", "preset": "fast", "x265-params": "log-level=error"}, (".mp4",)
    ),
    "av1": Encoder("libsvtav1", {"crf": "28", "preset": "9"}, (".mp4", ".webm")),
    "vp9": Encoder(
        "libvpx-vp9",
        # auto-alt-ref: frames that are never shown have no opacity
        {"crf": "28", "b": "0", "cpu-used": "5", "row-mt": "1", "tile-columns": "4"}
        | {"auto-alt-ref": "0"},
        (".webm",),
        transparent="yuva420p",
    ),
    "webp": Encoder("libwebp_anim", {"quality": "85"}, (".webp",), "bgra", "bgra"),
}
ENDINGS = {".mp4": "h264", ".webm": "vp9", ".webp": "webp"}  # and their usual codecs


def encoder(path: Path, codec: str | None = None, transparent: bool = False) -> Encoder:
    """The encoder for a file, by default the usual one for its ending.

    Raises:
        ValueError: There is none, it doesn't go into such a file, or it knows no opacity.
    """
    import av

    codec = codec or ENDINGS.get(path.suffix)
    if codec is None or path.suffix not in CODECS[codec].endings:
        endings = " or ".join(CODECS[codec].endings if codec else ENDINGS)
        raise ValueError(f"{path}: a video file has to end in {endings}")
    chosen = CODECS[codec]
    if transparent and not chosen.transparent:
        able = " or ".join(name for name, one in CODECS.items() if one.transparent)
        raise ValueError(f"{codec} has no opacity; {able}, or a folder of pictures, has it")
    try:
        av.Codec(chosen.name, "w")
    except ValueError as error:  # av's own is one
        message = f"this machine's PyAV has no encoder for {codec} ({chosen.name})"
        raise ValueError(message) from error
    return chosen
