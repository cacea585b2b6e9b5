"""Decode the HEVC picture of a HEIF file, in a process of its own.

A decoder of a hundred thousand lines of C reads what strangers wrote.  So it runs in a child
process, which gets the coded bytes alone, opens no file of the user's, is bounded in memory and
time where the system can do that, and returns as many bytes as the picture has been declared to
have.  If it crashes, the picture is damaged and the program goes on.

The decoder is FFmpeg's, in PyAV, and not under the GPL: docs/licenses.md.
"""

import importlib.util
import json
import sys
from contextlib import suppress

from .children import start
from .heif import Heif, HeifError, area, read_places
from .reading import open_file

SECONDS = 120  # for one picture, which takes about one
BLOCK = 64  # HEVC's largest: what is coded may be larger than the picture by less
MEMORY = 2 * 2**30  # bytes of addresses of the child, and for each pixel
MEMORY_A_PIXEL = 24
HDR, NO_DECODER, DAMAGED = 3, 4, 5  # exit codes of the child
PQ, HLG = 16, 18  # FFmpeg's numbers of transfer functions
UNSPECIFIED, BT601, STUDIO, FULL = 2, 5, 1, 2  # ... of matrices, of ranges
MATRICES = {1: 1, 9: 9, 10: 9}  # BT.709, BT.2020; all others are taken for BT.601
REASONS = {  # and, perhaps, what to do
    HDR: ("it is in HDR, PQ or HLG", "photograph with HDR switched off, or store it as JPEG"),
    NO_DECODER: ("FFmpeg, as it is installed with PyAV, has no decoder of HEVC",),
    DAMAGED: ("it is damaged, or coded in a way that FFmpeg does not read",),
}
CHILD = f"from {__name__} import main\nmain()"


def is_possible() -> bool:
    """Whether PyAV is installed."""
    return importlib.util.find_spec("av") is not None


def decode(path, heif: Heif) -> bytes:
    """The picture as it is stored, in rows of red, green, blue.  [height * width * 3]

    Raises:
        HeifError: It is damaged, or has something that is not read.
        OSError: The file, or a process, can't be opened.
    """
    import subprocess  # late, as in children.py

    with open_file(path) as stream:
        tiles = [b"".join(read_places(stream, places)) for places in heif.places]
    order = {
        "stored": heif.stored,
        "tile": heif.tile,
        "columns": heif.columns,
        "colors": heif.colors,
        "lengths": [len(heif.config), *map(len, tiles)],
    }
    coded = b"".join([json.dumps(order).encode(), b"\n", heif.config, *tiles])
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with start(CHILD, **pipes) as process:
        try:
            pixels, _ = process.communicate(coded, SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            raise HeifError(f"it could not be decoded within {SECONDS} s") from None
        except BaseException:
            process.kill()
            raise
    if process.returncode or len(pixels) != 3 * area(heif.stored):
        raise HeifError(*REASONS.get(process.returncode, REASONS[DAMAGED]))
    return pixels


def main() -> None:
    """The child: from stdin to stdout.  An error ends it, as it does a damaged picture."""
    stream = sys.stdin.buffer
    order = json.loads(stream.readline())
    config, *tiles = (stream.read(length) for length in order["lengths"])
    bound(MEMORY + MEMORY_A_PIXEL * (area(order["stored"]) + area(order["tile"])))
    try:
        pixels = decoded(order, config, tiles)
    except ImportError:
        sys.exit(NO_DECODER)
    sys.stdout.buffer.write(pixels)


def bound(memory: int) -> None:
    """Limit this process, where the system can: Windows can't."""
    try:
        import resource
    except ImportError:
        return
    for kind, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, SECONDS)):
        with suppress(ValueError, OSError):  # it is lower already, or this system has no such limit
            resource.setrlimit(kind, (most, most))


def decoded(order, config: bytes, tiles) -> bytearray:
    """The pixels of tiles side by side; see `decode`."""
    import av
    from av.video.reformatter import VideoReformatter

    if "hevc" not in av.codecs_available:
        sys.exit(NO_DECODER)
    (width, height), (wide, high) = order["stored"], order["tile"]
    pixels, convert = bytearray(3 * width * height), VideoReformatter()
    for number, tile in enumerate(tiles):
        frame = frame_of(av, config, tile, wide, high)
        if not (wide <= frame.width < wide + BLOCK and high <= frame.height < high + BLOCK):
            sys.exit(DAMAGED)
        plane = rgb_plane(frame, order["colors"], convert)
        row, column = divmod(number, order["columns"])
        left, top = column * wide, row * high
        shown, rows = 3 * min(wide, width - left), memoryview(plane)
        for y in range(min(high, height - top)):
            begin, source = 3 * ((top + y) * width + left), y * plane.line_size
            pixels[begin : begin + shown] = rows[source : source + shown]
    return pixels


def frame_of(av, config: bytes, tile: bytes, wide: int, high: int):
    """The one picture of a tile, an av.VideoFrame."""
    decoder = av.CodecContext.create("hevc", "r")
    decoder.extradata, decoder.thread_count = config, 1
    largest = (wide + 2 * BLOCK) * (high + 2 * BLOCK)  # FFmpeg rounds up further
    decoder.options = {"max_pixels": str(largest), "err_detect": "crccheck+explode"}
    frames = [*decoder.decode(av.Packet(tile)), *decoder.decode(None)]
    if len(frames) != 1 or frames[0].is_corrupt:
        sys.exit(DAMAGED)
    return frames[0]


def rgb_plane(frame, colors, convert):
    """Red, green and blue of a frame, as FFmpeg's plane.

    HEIF's word counts before HEVC's own; the range is the full one if either says so.  Colors stay
    in the file's space, as those of a JPEG do; where nothing is said, the matrix is BT.601's.
    """
    from av.video.reformatter import Interpolation as How

    transfer, matrix, is_full = colors or (frame.color_trc, frame.colorspace, False)
    if transfer in (PQ, HLG):
        sys.exit(HDR)
    matrix = frame.colorspace if matrix == UNSPECIFIED else matrix
    # HEVC that leaves it out means the other one; HEIC of a Sony ILCE-7M4 denies it in HEIF alone.
    is_full = is_full or frame.color_range == FULL
    plain = convert.reformat(
        frame,
        format="rgb24",
        # What FFmpeg does otherwise darkens by half a shade, and repeats coarse samples of colors.
        interpolation=How.BILINEAR | How.ACCURATE_RND | How.FULL_CHR_H_INT,
        src_colorspace=MATRICES.get(matrix, BT601),
        src_color_range=FULL if is_full else STUDIO,
        dst_color_range=FULL,
        threads=1,
    )
    return plain.planes[0]
