"""Frames of HDR video, PQ or HLG, as sRGB: what a screen of a photograph shows.

A telephone's HDR video, decoded as if it were any other, is pale and gray.  Its signal s in 0 to 1
is made linear [cd/m²], by SMPTE ST 2084 (PQ) or by ARIB STD-B67 with the look of a screen of PEAK
(HLG; E the scene's light, Y its luminance):

    PQ:   L = 10000 (max(s^(1/m2) - c1, 0) / (c2 - c3 s^(1/m2)))^(1/m1)
    HLG:  E = s²/3 up to 1/2, (exp((s - c)/a) + b)/12 above;  L = PEAK Y^0.2 E

It is divided by WHITE, the light of paper by BT.2408.  Colors of BT.2020 become those of BT.709.
What is brighter than KNEE is pressed below 1, without a change of hue: the largest of r, g, b is

    x up to KNEE, 1 - (1 - KNEE) exp(-(x - KNEE)/(1 - KNEE)) above.

No standard has this curve, or KNEE.  With 0.6, paper becomes 0.85 (238 of 255 in sRGB), and light
twice as bright 0.99; a lower knee makes paper gray, a higher one burns out more.
"""

import numpy as np

from .photos import CaptureError

PQ, HLG = 16, 18  # FFmpeg's numbers of transfer functions
PEAK, WHITE, KNEE = 1000.0, 203.0, 0.6
FULL_RANGE = 2
# Red's and blue's share of luminance, by FFmpeg's numbers of Y'CbCr; 2: nobody says.
SHARES = dict.fromkeys((2, 9), (0.2627, 0.0593)) | {1: (0.2126, 0.0722)}
SHARES |= dict.fromkeys((5, 6), (0.299, 0.114))
BT2020 = [
    [1.660491, -0.587641, -0.072850],
    [-0.124550, 1.132900, -0.008349],
    [-0.018151, -0.100579, 1.118730],
]  # linear colors to BT.709's
P3 = [[1.224940, -0.224940, 0.0], [-0.042057, 1.042057, 0.0], [-0.019638, -0.078636, 1.098274]]
TO_BT709 = {1: np.eye(3), 2: BT2020, 9: BT2020, 12: P3}  # by FFmpeg's numbers of primaries


def is_hdr(frame) -> bool:
    """Whether an av.VideoFrame is in PQ or HLG."""
    return frame.color_trc in (PQ, HLG)


def check_color(path, frame):
    """CaptureError if a frame is in HDR whose colors can't be converted."""
    known = frame.format.is_rgb or frame.colorspace in SHARES
    if is_hdr(frame) and not (known and frame.color_primaries in TO_BT709):
        raise CaptureError(
            f"{path} is an HDR video in colors that can't be converted (FFmpeg's color space "
            f"{frame.colorspace:d}, primaries {frame.color_primaries:d}): convert it to SDR, or "
            f"record with HDR switched off"
        )


def standard(frame, size):
    """An HDR frame as sRGB.  [h, w, 3] uint8

    Args:
        frame: An av.VideoFrame that check_color lets pass.
        size: Width and height to shrink it to.
    """
    signal = np.clip(rgb_signal(frame, size), 0.0, 1.0)
    light = from_pq(signal) if frame.color_trc == PQ else from_hlg(signal)
    colors = light / WHITE @ np.array(TO_BT709[frame.color_primaries], np.float32).T
    colors = np.maximum(colors, 0.0)
    largest = np.maximum(colors.max(axis=-1, keepdims=True), 1e-6)
    return np.round(255.0 * srgb(colors * (pressed(largest) / largest))).astype(np.uint8)


def rgb_signal(frame, size):
    """r, g, b as they are stored, about 0 to 1.  [h, w, 3] float32"""
    if frame.format.is_rgb:
        shrunk = frame.reformat(*size, "rgb48le", interpolation="AREA")
        return shrunk.to_ndarray().astype(np.float32) / 65535.0
    bits = frame.format.components[0].bits
    samples = frame.reformat(*size, "yuv444p16le", interpolation="AREA").to_ndarray()
    y, blue, red = np.moveaxis(samples.astype(np.float32), -1, 0)
    if frame.color_range == FULL_RANGE:
        low, high, wide = 0.0, ((1 << bits) - 1) << (16 - bits), ((1 << bits) - 1) << (16 - bits)
    else:
        low, high, wide = 16 << 8, 235 << 8, 224 << 8
    y, blue, red = (y - low) / (high - low), (blue - 32768.0) / wide, (red - 32768.0) / wide
    of_red, of_blue = SHARES[frame.colorspace]
    r, b = y + 2.0 * (1.0 - of_red) * red, y + 2.0 * (1.0 - of_blue) * blue
    g = (y - of_red * r - of_blue * b) / (1.0 - of_red - of_blue)
    return np.stack([r, g, b], axis=-1)


def from_pq(signal):
    """Light [cd/m²] of PQ's signal."""
    m1, m2, c1, c2, c3 = 0.1593017578125, 78.84375, 0.8359375, 18.8515625, 18.6875
    power = signal ** (1.0 / m2)
    return 1e4 * (np.maximum(power - c1, 0.0) / (c2 - c3 * power)) ** (1.0 / m1)


def from_hlg(signal):
    """Light [cd/m²] of HLG's signal, on a screen of PEAK.  [..., 3]"""
    a = 0.17883277
    b, c = 1.0 - 4.0 * a, 0.5 - a * np.log(4.0 * a)
    scene = np.where(signal <= 0.5, signal**2 / 3.0, (np.exp((signal - c) / a) + b) / 12.0)
    luminance = scene @ np.array([0.2627, 0.6780, 0.0593], scene.dtype)
    return PEAK * luminance[..., None] ** 0.2 * scene


def pressed(x):
    """The tone curve: 0 to infinity becomes 0 to 1."""
    return np.where(x <= KNEE, x, 1.0 - (1.0 - KNEE) * np.exp((KNEE - x) / (1.0 - KNEE)))


def srgb(linear):
    """sRGB's signal of linear colors, 0 to 1 both."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
