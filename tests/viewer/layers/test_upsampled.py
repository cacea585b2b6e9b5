"""The upsampled image: the shader is its reference; what stands still becomes exact."""

import numpy as np
import pytest
import warp as wp

from deformrf.core.render import PastView, Renderer, RenderOptions, phases, places_before, strided
from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.layers.upload import ImageTexture
from deformrf.viewer.layers.upsampled import CoarsePicture, UpsampledImage, object_box
from deformrf.viewer.scene import Scene

pytestmark = pytest.mark.gl
SIZE = 83, 61
STEEPEST = 6.0  # as in the shader
WHITE = 1.0, 1.0, 1.0


def found_at(place, ts, colors, depths, slack):
    """The share of the four nearest pixels that show what is so far away, and their color."""
    height, width = depths.shape
    if not (0 <= place[0] <= width and 0 <= place[1] <= height):
        return 0.0, None
    low = np.floor(np.array(place) - 0.5).astype(int)
    share = np.array(place) - 0.5 - low
    total, mean = 0.0, np.zeros(4)
    for i, j in np.ndindex(2, 2):
        row, column = np.clip(low[1] + i, 0, height - 1), np.clip(low[0] + j, 0, width - 1)
        weight = (share[1] if i else 1 - share[1]) * (share[0] if j else 1 - share[0])
        far, there = np.isinf(depths[row, column]), colors[row, column, 3] > 0
        nearest, farthest = min(ts), max(ts)
        if np.isinf(farthest):
            shows = far and not there
        else:
            depth = depths[row, column]
            shows = nearest - slack(nearest) <= depth <= farthest + slack(farthest)
            shows |= far and there
        total += weight * shows
        mean += weight * shows * colors[row, column]
    return total, mean / max(total, 1e-6)


def reference(coarse, places, rays, camera, colors, depths):
    """The image of a coarse picture and the image before, in float64, pixel by pixel."""
    stride, phase = rays
    slack = lambda t: STEEPEST / camera.focal * t  # noqa: E731
    differences = np.zeros(coarse.shape)
    for at in np.ndindex(coarse.shape[:2]):
        share, was = found_at(places[at][:2], [places[at][2]], colors, depths, slack)
        if share >= 0.5:
            differences[at] = coarse[at] - was
    image, depth = np.zeros(colors.shape), np.zeros(depths.shape)
    for y, x in np.ndindex(depths.shape):
        at = (np.array([x, y]) - phase) / stride
        low, share = np.floor(at).astype(int), at - np.floor(at)
        high = low + (share > 0)
        last = np.array(coarse.shape[1::-1]) - 1
        low, high = np.clip(low, 0, last), np.clip(high, 0, last)
        four = [(r, c) for r in (low[1], high[1]) for c in (low[0], high[0])]
        if (share == 0).all() and (at == low).all():
            image[y, x], depth[y, x] = coarse[four[0]], places[four[0]][3]
            continue
        weights = [v * u for v in (1 - share[1], share[1]) for u in (1 - share[0], share[0])]
        weights, now = np.array(weights), np.array([places[one][3] for one in four])
        nearest = now.min()
        front = np.ones(4, bool)
        if np.isfinite(nearest):
            front = now <= nearest + slack(nearest) * max(stride)
        layers = [weights * front, weights * ~front]
        for own in layers:
            if own.sum() < 1e-3:
                continue
            used = [(w, one) for w, one in zip(own / own.sum(), four, strict=True) if w > 0]
            ends = [(phase[0] + stride[0] * c, phase[1] + stride[1] * r) for _, (r, c) in used]
            moved = [
                w * (places[one][:2] + np.array([x, y]) - end)
                for (w, one), end in zip(used, ends, strict=True)
            ]
            place = sum(moved)
            ts = [places[one][2] for _, one in used]
            found, was = found_at(place, ts, colors, depths, slack)
            if found >= 0.5:
                change = sum(w * differences[one] for w, one in used)
                image[y, x] = np.clip(was + change, 0.0, 1.0)
                depth[y, x] = sum(w * places[one][3] for w, one in used)
                break
        else:
            own = layers[0] if layers[0].sum() >= 0.5 else layers[1]
            used = [(w, one) for w, one in zip(own / own.sum(), four, strict=True) if w > 0]
            image[y, x] = sum(w * coarse[one] for w, one in used)
            depth[y, x] = sum(w * places[one][3] for w, one in used)
    return image, depth


class Stand:
    """A ball that is bent and looked at, and images of it."""

    def __init__(self, field, context):
        self.context, self.scene, self.renderer = context, Scene(field, "ball", "cpu"), None
        self.renderer = Renderer(field)
        self.rest = field.mesh.rest_vertices
        self.camera = orbits.camera_of(self.scene.orbit, *SIZE)

    def bend(self, amount):
        self.renderer.set_vertices(self.rest + amount * np.sin(2.0 * self.rest[:, [1, 2, 0]]))

    def sight(self):
        return PastView(self.camera, wp.clone(self.renderer.pose.vertices))

    def full(self):
        image = self.renderer.render(self.camera, RenderOptions())
        texture = ImageTexture(self.context, SIZE)
        texture.write(image)
        return texture, image

    def coarse(self, stride, phase, before, moved=True):
        camera = strided(self.camera, stride, phase)
        image = self.renderer.render(camera, RenderOptions(details=True))
        colors = image.color_array()
        box = object_box(colors)
        places = places_before(image, camera, self.renderer, before, box).numpy()
        return CoarsePicture(colors, box, places, stride, phase, moved)

    def read(self, image):
        width, height = SIZE
        color = np.frombuffer(image.color.read(), np.uint8).reshape(height, width, 4)
        return color, np.frombuffer(image.depth.read(), np.float32).reshape(height, width)


@pytest.fixture
def stand(ball, window):
    return Stand(ball, window[1])


def decibels(image, wanted):
    seen = wanted[..., 3] > 0
    error = image[seen][:, :3].astype(float) - wanted[seen][:, :3]
    return 10.0 * np.log10(255.0**2 / max((error**2).mean(), 1e-9))


@pytest.mark.parametrize("stride", [(2, 2), (3, 2), (4, 4)])
def test_the_shader_is_its_reference(stand, stride):
    stand.bend(0.0)
    texture, full = stand.full()
    before = stand.sight()
    stand.bend(0.15)
    stand.scene.orbit = orbits.turned(stand.scene.orbit, 6, 2, 120)
    stand.camera = orbits.camera_of(stand.scene.orbit, *SIZE)
    picture = stand.coarse(stride, (1, 1), before)
    image = UpsampledImage(stand.context, SIZE)
    image.add(picture, stand.camera, WHITE, texture)
    shown, depth = stand.read(image)
    places = np.full((*picture.colors.shape[:2], 4), np.inf)
    places[...] = [-1e6, -1e6, np.inf, np.inf]  # beyond the box is background
    first, last, left, right = picture.box
    places[first:last, left:right] = picture.places
    wanted, wanted_depth = reference(
        picture.colors / 255.0,
        places,
        (stride, picture.phase),
        stand.camera,
        full.color_array() / 255.0,
        full.depth_array().astype(float),
    )
    error = abs(shown / 255.0 - wanted).max(axis=-1)
    assert (error > 0.01).mean() < 2e-3  # where a share is about ½, a rounding decides
    assert np.median(error) <= 0.003
    near = np.isfinite(wanted_depth) & np.isfinite(depth)
    assert (np.isfinite(wanted_depth) == np.isfinite(depth)).mean() > 0.998
    assert np.quantile(abs(depth - wanted_depth)[near], 0.995) < 1e-3


@pytest.mark.parametrize("stride", [(2, 2), (3, 2), (4, 3)])
def test_what_stands_still_becomes_the_full_image(stand, stride):
    stand.bend(0.1)
    _, full = stand.full()
    image = UpsampledImage(stand.context, SIZE)
    image.clear(WHITE)
    errors = []
    for k, phase in enumerate(phases(stride)):
        image.add(stand.coarse(stride, phase, stand.sight(), k == 0), stand.camera, WHITE)
        errors.append(decibels(stand.read(image)[0], full.color_array()))
    assert np.diff(errors).min() > 0.0
    shown, _ = stand.read(image)
    assert abs(shown.astype(int) - full.color_array()).max() <= 1


def test_what_moves_is_sharper_than_its_coarse_picture(stand):
    stand.bend(0.0)
    image, before = UpsampledImage(stand.context, SIZE), None
    image.clear(WHITE)
    for k in range(8):
        stand.bend(0.02 * k)
        sight = stand.sight()
        picture = stand.coarse((2, 2), phases((2, 2))[k % 4], before or sight)
        image.add(picture, stand.camera, WHITE)
        if k == 0:
            image_of_first = stand.read(image)[0]
            first = decibels(image_of_first, stand.full()[1].color_array())
        before = sight
    last = decibels(stand.read(image)[0], stand.full()[1].color_array())
    assert last > first + 3.0


def test_what_is_uncovered_shows_nothing_of_what_hid_it(stand):
    """The image before shows the object elsewhere: none of it is left where it was."""
    stand.bend(0.0)
    texture, _ = stand.full()
    before = stand.sight()
    stand.renderer.set_vertices(stand.rest + np.array([3.0, 0.0, 0.0]))
    picture = stand.coarse((2, 2), (0, 0), before)
    image = UpsampledImage(stand.context, SIZE)
    image.add(picture, stand.camera, WHITE, texture)
    _, full = stand.full()
    away = full.color_array()[..., 3] == 0
    shown, depth = stand.read(image)
    assert away.any()
    assert (shown[away, :3] > 250).mean() > 0.99 and np.isinf(depth[away]).mean() > 0.97


def test_an_empty_picture_is_background(stand):
    stand.bend(0.0)
    picture = stand.coarse((2, 2), (0, 0), stand.sight())
    image = UpsampledImage(stand.context, SIZE)
    image.add(picture, stand.camera, WHITE)
    blank = CoarsePicture(np.zeros((31, 42, 4), np.uint8), None, None, (2, 2), (0, 0))
    image.add(blank, stand.camera, (0.2, 0.4, 0.6))
    shown, depth = stand.read(image)
    assert (shown == [51, 102, 153, 0]).all() and np.isinf(depth).all()


def test_the_box_of_a_picture_holds_all_of_its_object():
    colors = np.zeros((20, 30, 4), np.uint8)
    assert object_box(colors) is None
    colors[6, 9, 3] = colors[11, 28, 3] = 1
    assert object_box(colors) == (4, 14, 7, 30)
