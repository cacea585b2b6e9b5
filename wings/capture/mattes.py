"""Tell what turns from what stands still, in the photographs of one ring (still.py).

At each pixel, the background is the color that most of the ring's photographs have, where at least
half of them have it, as far as such pixels join the image's border; elsewhere it is unknown, for
the object covers the pixel too often.  Each photograph is first brought to the ring's median in
red, green and blue, because a camera's exposure and white balance drift.  Then a pixel shows

* the background, if it has its color;
* the object, if it has another one; at its edge, only in part of the pixel;
* perhaps the object, if the background is not known, or has that color in a shade: then it may be
  the object's shadow.  The votes of other views decide (carving.py).
"""

from dataclasses import dataclass

import numpy as np

# What a pixel of a matte shows; above UNKNOWN a part of it is the object's, at OBJECT all.
BACKGROUND, UNKNOWN, OBJECT = 0, 128, 255
MATTE_SIDE = 1000  # longer side that photographs are looked at [pixels]
SAMPLES = 48  # photographs of a ring that say what its background is
CANDIDATES = 12  # of these, whose color may be the background's
SAME = 12.0  # of 255: colors that differ less are the same, unless the noise is larger
NOISE = 5.0  # standard deviations of a background that is the same
KNOWN = 0.5  # of the photographs that show it
GAIN, GAIN_STEP = 0.5, 0.005  # how far brightness may drift, and what is told apart [log]
DARKEST, BRIGHTEST = 20.0, 235.0  # of colors that tell how bright a photograph is
SHADE, SAME_TINT = 0.3, 0.05  # darkest shadow; how much more of one color than of another it takes
ISLAND = 0.02  # of the object: a smaller piece of background within it may be a color alike
EDGE, NEAR = 2, 2.0  # pixels from where all is background; how far inner colors reach
BAND = 64  # rows that are looked at at a time


@dataclass(frozen=True)
class Background:
    """What stands still in a ring.

    Attributes:
        color: [h, w, 3] float32, 0 to 255
        known: Where enough photographs show it.  [h, w] bool
        same: Colors that differ less are the same.
    """

    color: np.ndarray
    known: np.ndarray
    same: float


def background_of(images: np.ndarray) -> Background:
    """The background of a ring.  [n, h, w, 3] uint8"""
    median = np.median(images, axis=0).astype(np.float32)
    gains = np.stack([gain_of(image, median) for image in images])
    shape = median.shape[:2]
    color, support, noise = np.empty_like(median), np.empty(shape), np.empty(shape)
    same = SAME
    for _ in range(2):
        for top in range(0, len(median), BAND):
            rows = slice(top, top + BAND)
            equal = images[:, rows] / gains[:, None, None]
            color[rows], support[rows], noise[rows] = most_frequent(equal, same)
        wanted = NOISE * np.median(noise[support >= KNOWN]) if (support >= KNOWN).any() else 0.0
        if wanted <= same:
            break
        same = float(wanted)
    return Background(color, reached(support >= KNOWN), same)


def reached(known):
    """What is known and joined to the image's border: the object's own colors may be islands.

    [h, w] bool, both
    """
    from scipy.ndimage import label

    labels = label(known)[0]
    border = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    return np.isin(labels, np.setdiff1d(border, 0))


def most_frequent(images, same: float):
    """The color of each pixel that most images have.

    Args:
        images: [n, h, w, 3]

    Returns:
        It, the share of images that have it, and how much they differ.  [h, w, 3], [h, w] twice
    """
    candidates = np.unique(np.linspace(0, len(images) - 1, CANDIDATES).round().astype(int))
    color, most = images[0].copy(), np.zeros(images.shape[1:3])
    for candidate in images[candidates]:
        near = (abs(images - candidate).max(axis=-1) < same)[..., None]
        count = near.sum(axis=0)[..., 0]
        mean = (images * near).sum(axis=0) / np.maximum(count, 1)[..., None]
        better = count > most
        color[better], most[better] = mean[better], count[better]
    off = images - color
    near = abs(off).max(axis=-1) < same
    count = np.maximum(near.sum(axis=0), 1)
    return color, near.mean(axis=0), np.sqrt(((off**2).mean(axis=-1) * near).sum(axis=0) / count)


def mattes_of(read, numbers, advance=lambda count: None):
    """Yield the number and the matte of each photograph of a ring.

    Args:
        read: Called with a number, it returns the photograph, all of one size.  [h, w, 3] uint8
        advance: Called with the number of mattes that are done.
    """
    some = np.unique(np.linspace(0, len(numbers) - 1, SAMPLES).round().astype(int))
    background = background_of(np.stack([read(numbers[n]) for n in some]))
    for done, number in enumerate(numbers, start=1):
        yield number, matte_of(read(number), background)
        advance(done)


def gain_of(image, reference):
    """How much brighter than another an image is, where it shows the same: most pixels.  [3]

    Args:
        image, reference: [h, w, 3]
    """
    edges = np.arange(-GAIN, GAIN + GAIN_STEP, GAIN_STEP)
    gains = []
    for channel in range(3):
        one, other = image[..., channel].ravel(), reference[..., channel].ravel()
        used = (other > DARKEST) & (other < BRIGHTEST) & (one > 0) & (one < 255)
        logs = np.log(one[used] / other[used])
        counts = np.convolve(np.histogram(logs, edges)[0], np.ones(5), "same")
        center = edges[counts.argmax()] + 0.5 * GAIN_STEP
        near = logs[abs(logs - center) < 5.0 * GAIN_STEP]
        gains.append(np.exp(near.mean()) if len(near) else 1.0)
    return np.array(gains, np.float32)


def matte_of(image, background: Background) -> np.ndarray:
    """What each pixel of a photograph shows, from BACKGROUND to OBJECT.  [h, w] uint8

    Args:
        image: [h, w, 3] uint8
    """
    from scipy.ndimage import binary_closing, binary_opening, label, uniform_filter

    color, same = background.color, background.same
    equal = image / gain_of(image, color)
    differs = abs(equal - color).max(axis=-1) > same
    # A single pixel decides nothing about a shadow, since a pixel's noise is its own.
    smooth = [uniform_filter(a, size=(3, 3, 1)) for a in (equal, color)]
    shades = smooth[0] / np.maximum(smooth[1], 1.0)
    shade = shades.mean(axis=-1)
    is_shadow = (shade > SHADE) & (shade < 1.0)
    is_shadow &= abs(shades - shade[..., None]).max(axis=-1) < SAME_TINT
    unknown = ~background.known | (differs & is_shadow)
    kept = binary_opening(binary_closing(unknown | differs))  # the rest are crumbs of noise
    islands, count = label(~kept)
    small = np.bincount(islands.ravel(), minlength=count + 1) < ISLAND * np.count_nonzero(kept)
    small[0] = False
    kept, unknown = kept | small[islands], unknown | small[islands]
    shares = UNKNOWN + 1 + (OBJECT - UNKNOWN - 1) * object_shares(equal, color, kept, 2.0 * same)
    return np.where(kept, np.where(unknown, UNKNOWN, shares.round()), BACKGROUND).astype(np.uint8)


def object_shares(image, color, kept, apart: float):
    """How much of each pixel is the object's, if its color is that of pixels farther inside.

    Args:
        image, color: The photograph and its background.  [h, w, 3]
        kept: Where the object may be.  [h, w] bool
        apart: Colors of object and background that are nearer tell nothing: all is the object's.

    Returns:
        0 to 1.  [h, w]
    """
    from scipy.ndimage import binary_erosion, gaussian_filter

    inside = binary_erosion(kept, np.ones((3, 3)), iterations=EDGE)
    weights = gaussian_filter(inside.astype(np.float32), NEAR)
    inner = gaussian_filter(image * inside[..., None], (NEAR, NEAR, 0))
    off = inner / np.maximum(weights, 1e-6)[..., None] - color
    length = np.linalg.norm(off, axis=-1)
    told = ~inside & (weights > 1e-3) & (length > apart)
    share = ((image - color) * off).sum(axis=-1) / np.maximum(length, 1e-6) ** 2
    return np.where(told, np.clip(share, 0.0, 1.0), 1.0)
