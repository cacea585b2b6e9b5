"""The upsampled image: the native code is its reference; what stands still becomes exact."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from places import places_of
from scipy.ndimage import maximum_filter

from deformrf.core.render import (
    PastView,
    Renderer,
    RenderOptions,
    Upsampling,
    from_field_of_view,
    look_at,
)
from deformrf.core.render.temporal import phases, strided, surfaces
from deformrf.core.render.upsampling import CoarsePicture, _Target, add_coarse, object_box

SIZE = 83, 61
STEEPEST, ALIKE = 6.0, 0.5  # as in upsampling.py
DOUBTFUL, UNSEEN = 2.55, 0.7
WHITE = 1.0, 1.0, 1.0


def cubic(u):
    """Catmull-Rom's weights of four numbers in a row, u behind the second one."""
    powers = np.array([1.0, u, u * u, u**3])
    return 0.5 * np.array([[0, -1, 2, -1], [2, 0, -5, 3], [0, 1, 4, -3], [0, 0, -1, 1]]) @ powers


def found_at(place, ts, colors, depths, slack):
    """The color at a place of what is so far away; None if another thing is there."""
    height, width = depths.shape
    if not (0 <= place[0] <= width and 0 <= place[1] <= height):
        return None
    low = np.floor(np.array(place) - 0.5).astype(int)
    share = np.array(place) - 0.5 - low
    if np.isinf(max(ts)):
        nearest = farthest = np.inf  # nothing but the background
    else:
        nearest, farthest = min(ts) - slack(min(ts)), max(ts) + slack(max(ts))
    near, empty, mean = 0.0, 0.0, np.zeros(4)
    for i, j in np.ndindex(2, 2):
        row, column = np.clip(low[1] + i, 0, height - 1), np.clip(low[0] + j, 0, width - 1)
        weight = (share[1] if i else 1 - share[1]) * (share[0] if j else 1 - share[0])
        far, there = np.isinf(depths[row, column]), colors[row, column, 3] > 0
        near += weight * (there if far else nearest <= depths[row, column] <= farthest)
        empty += weight * (far and not there)
        mean += weight * colors[row, column]
    if np.isinf(max(ts)):
        return np.array([*WHITE, 0.0]) if empty >= 0.5 else None
    if near == 0.0 or near + empty < 0.5:
        return None
    if low.min() < 1 or low[0] > width - 3 or low[1] > height - 3:
        return mean
    rows, columns = (slice(start - 1, start + 3) for start in low[::-1])
    around = depths[rows, columns]
    if not (np.isinf(around) | ((around >= nearest) & (around <= farthest))).all():
        return mean
    return np.einsum("i,j,ijk->k", cubic(share[1]), cubic(share[0]), colors[rows, columns])


def layer_in(pixel, corners, own):
    """The corners of a layer in a pixel with their weights: column, row, weight."""
    (x, y), (left, top, nx, ny) = pixel, corners
    right, below = (x - left) / nx, (y - top) / ny
    weights = [v * u for v in (1 - below, below) for u in (1 - right, right)]
    used = [(k, w) for k, w in enumerate(weights) if own[k] and w > 0.0]
    return used, sum(w for _, w in used)


def reference(coarse, places, rays, camera, colors, depths):
    """The image of a coarse picture and the image before, in float64, pixel by pixel."""
    stride, phase = rays
    slack = lambda t: STEEPEST / camera.focal * (1.0 if camera.parallel else t)  # noqa: E731
    differences, doubts = np.zeros(coarse.shape), np.full(coarse.shape[:2], UNSEEN)
    for at in np.ndindex(coarse.shape[:2]):
        was = found_at(places[at][:2], [places[at][2]], colors, depths, slack)
        if was is not None:
            differences[at] = coarse[at] - was
            doubts[at] = DOUBTFUL * abs(differences[at]).max()
    image, depth = np.zeros(colors.shape), np.zeros(depths.shape)
    for y, x in np.ndindex(depths.shape):
        cell = np.floor((np.array([x, y]) - phase) / stride).astype(int)
        start = np.array(phase) + cell * stride
        last = np.array(coarse.shape[1::-1]) - 1
        low, high = np.clip(cell, 0, last), np.clip(cell + 1, 0, last)
        four = [(r, c) for r in (low[1], high[1]) for c in (low[0], high[0])]
        if (start == (x, y)).all() and cell.min() >= 0:
            image[y, x], depth[y, x] = coarse[four[0]], places[four[0]][3]
            continue
        if not any(coarse[one][3] for one in four):
            image[y, x], depth[y, x] = (*WHITE, 0.0), np.inf
            continue
        now = np.array([places[one][3] for one in four])
        front = now <= now.min() + slack(now.min()) * max(stride)
        ends = [(phase[0] + stride[0] * c, phase[1] + stride[1] * r) for r, c in four]
        moves = [places[one][:2] - end for one, end in zip(four, ends, strict=True)]

        def mean(used, weight, values):
            return sum(w * np.asarray(values[k]) for k, w in used) / weight

        found, layers = None, []
        for own in (front, ~front):
            used, weight = layer_in((x, y), (*start, *stride), own)
            if not used:
                continue
            place = mean(used, weight, moves) + np.array([x, y])
            layers.append((used, weight, place))
            ts = [places[one][2] for one, is_own in zip(four, own, strict=True) if is_own]
            found = found_at(place, ts, colors, depths, slack)
            if found is not None:
                break
        if found is None:
            used, weight, place = max(layers, key=lambda layer: layer[1])
            apart = np.linalg.norm(layers[0][2] - layers[-1][2])
            if len(layers) == 2 and apart < ALIKE:
                found = found_at(place, [0.0, 1e30], colors, depths, slack)
        image[y, x] = mean(used, weight, [coarse[one] for one in four])
        if found is not None:
            detail = found + mean(used, weight, [differences[one] for one in four]) - image[y, x]
            doubt = mean(used, weight, [doubts[one] for one in four])
            image[y, x] = np.clip(image[y, x] + detail / (1.0 + doubt**2), 0.0, 1.0)
        depth[y, x] = mean(used, weight, now)
    depth[image[..., 3] < 0.5] = np.inf
    return image, depth


class Stand:
    """A ball that is bent and looked at, and images of it."""

    def __init__(self, field):
        self.renderer = Renderer(field)
        self.rest = field.mesh.rest_vertices
        self.look_from((1.9, 0.5, 0.9))

    def look_from(self, eye, parallel=False):
        self.camera = from_field_of_view(look_at(eye, (0.5, 0.5, 0.5)), 0.7, *SIZE)
        if parallel:
            lens = replace(self.camera.lens, focal=(SIZE[1] / 1.4,) * 2)
            self.camera = replace(self.camera, parallel=True, lens=lens)

    def bend(self, amount):
        self.renderer.set_vertices(self.rest + amount * np.sin(2.0 * self.rest[:, [1, 2, 0]]))

    def sight(self):
        return PastView(self.camera, wp.clone(self.renderer.pose.vertices))

    def full(self):
        return self.renderer.render(self.camera, RenderOptions())

    def coarse(self, stride, phase, before, moved=True):
        camera = strided(self.camera, stride, phase)
        image = self.renderer.render(camera, RenderOptions(details=True))
        colors = image.color_array()
        box = object_box(colors)
        shown = surfaces(image, camera, self.renderer, before)
        return CoarsePicture(shown, box, stride, phase, moved)

    def become(self, picture, before):
        """The image that a coarse picture and the image before become."""
        target = _Target(SIZE[::-1], WHITE)
        add_coarse(picture, self.camera, WHITE, self.sight(), before, target.image)
        return target.image


@pytest.fixture
def stand(ball):
    return Stand(ball)


def decibels(image, wanted):
    image, wanted = image.color_array(), wanted.color_array()
    seen = wanted[..., 3] > 0
    error = image[seen][:, :3].astype(float) - wanted[seen][:, :3]
    return 10.0 * np.log10(255.0**2 / max((error**2).mean(), 1e-9))


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("stride", [(2, 2), (3, 2), (4, 4)])
def test_the_native_code_is_its_reference(stand, stride, parallel):
    stand.look_from((1.9, 0.5, 0.9), parallel)
    stand.bend(0.0)
    full, before = stand.full(), stand.sight()
    stand.bend(0.15)
    stand.look_from((1.85, 0.65, 0.95), parallel)
    picture = stand.coarse(stride, (1, 1), before)
    image = stand.become(picture, full)
    coarse = picture.shown.color.numpy() / 255.0
    places = np.full(coarse.shape, np.inf)
    places[...] = [-1e6, -1e6, np.inf, np.inf]  # beyond the box is background
    first, last, left, right = picture.box
    part = slice(first, last), slice(left, right)
    places[part] = places_of(picture.shown)[part]
    rays = stride, picture.phase
    before = full.color_array() / 255.0, full.depth_array().astype(float)
    wanted, wanted_depth = reference(coarse, places, rays, stand.camera, *before)
    depth = image.depth_array()
    error = abs(image.color_array() / 255.0 - wanted).max(axis=-1)
    assert (error > 0.01).mean() < 2e-3  # where a share is about ½, a rounding decides
    assert np.median(error) <= 0.003
    near = np.isfinite(wanted_depth) & np.isfinite(depth)
    assert (np.isfinite(wanted_depth) == np.isfinite(depth)).mean() > 0.998
    assert np.quantile(abs(depth[near] - wanted_depth[near]), 0.995) < 1e-3


@pytest.mark.parametrize("stride", [(2, 2), (3, 2), (4, 3)])
def test_what_stands_still_becomes_the_full_image(stand, stride):
    stand.bend(0.1)
    full, image = stand.full(), _Target(SIZE[::-1], WHITE).image
    errors = []
    for k, phase in enumerate(phases(stride)):
        image = stand.become(stand.coarse(stride, phase, stand.sight(), k == 0), image)
        errors.append(decibels(image, full))
    assert np.diff(errors).min() > 0.0
    assert abs(image.color_array().astype(int) - full.color_array()).max() <= 1
    np.testing.assert_array_equal(np.isinf(image.depth_array()), np.isinf(full.depth_array()))


@pytest.mark.parametrize("size", [(42, 30), (166, 122)])
def test_an_image_may_follow_one_of_another_size(stand, size):
    """After a bend, with 1/6 of the rays: it is nearer to the full image than without it."""
    stand.bend(0.1)
    full, before = stand.full(), stand.sight()
    stand.bend(0.12)
    stand.camera = stand.camera.resized(*size)
    picture = stand.coarse((3, 2), (1, 1), before)
    found = []
    for image in (full, _Target(SIZE[::-1], WHITE).image):
        target = _Target(size[::-1], WHITE)
        add_coarse(picture, stand.camera, WHITE, before, image, target.image)
        found.append(decibels(target.image, stand.full()))
    assert found[0] > found[1] + 1.5


def test_an_image_of_what_stands_still_stays(stand):
    """Even if it is said to have moved, next to nothing but single pixels of edges changes."""
    stand.bend(0.1)
    image = full = stand.full()
    for phase in phases((3, 2)):
        image = stand.become(stand.coarse((3, 2), phase, stand.sight()), image)
    error = abs(image.color_array().astype(int) - full.color_array()).max(axis=-1)
    assert (error > 8).mean() < 0.02 and np.median(error[full.color_array()[..., 3] > 0]) <= 1


@pytest.mark.parametrize("orbit", [0.0, 0.02])
def test_what_moves_is_sharper_than_its_coarse_picture(stand, orbit):
    """The same rays through a camera of fewer pixels, scaled up, are the first image."""
    upsampling, options, before, view = Upsampling(), RenderOptions(details=True), None, None
    for k in range(8):
        stand.bend(0.02 * k)
        stand.look_from((1.9, 0.5 + orbit * k, 0.9))
        upsampling.changed()
        coarse = upsampling.render(stand.renderer, stand.camera, (2, 2), options, view)
        now = coarse, stand.renderer, stand.camera, WHITE
        image, part = upsampling.upsampled(*now, view, before)
        full = stand.full()
        if k == 0:
            first = decibels(image, full)
        before, view = image, stand.sight()
        outside = np.ones(SIZE[::-1], bool)
        outside[part] = False
        assert not image.color_array()[outside, 3].any() and not upsampling.whole
    assert decibels(image, full) > first + 3.0


def test_a_camera_at_rest_has_all_rays_after_one_picture_of_each_phase(stand):
    upsampling, options, before, view = Upsampling(), RenderOptions(details=True), None, None
    stand.bend(0.1)
    while not upsampling.whole:
        coarse = upsampling.render(stand.renderer, stand.camera, (3, 2), options, view)
        before, _ = upsampling.upsampled(coarse, stand.renderer, stand.camera, WHITE, view, before)
        view = stand.sight()
    full = stand.full()
    assert abs(before.color_array().astype(int) - full.color_array()).max() <= 1


def test_what_is_uncovered_shows_nothing_of_what_hid_it(stand):
    """The image before shows the object elsewhere: none of it is left where it was."""
    stand.bend(0.0)
    before, full = stand.sight(), stand.full()
    stand.renderer.set_vertices(stand.rest + np.array([0.0, 0.5, 0.0]))
    image = stand.become(stand.coarse((2, 2), (0, 0), before), full)
    near = maximum_filter(stand.full().color_array()[..., 3], 5) > 0  # its silhouette, too
    hid = full.color_array()[..., 3] > 0
    assert (hid & ~near).sum() > 100
    assert (image.color_array()[~near] == [255, 255, 255, 0]).all()
    assert np.isinf(image.depth_array()[~near]).all()


def test_an_empty_picture_is_background(stand):
    upsampling, options, color = Upsampling(), RenderOptions(details=True), (0.2, 0.4, 0.6)
    before = view = None
    for away in (0.0, 1e3, 1e3, 1e3):
        stand.renderer.set_vertices(stand.rest + away)
        upsampling.changed()
        coarse = upsampling.render(stand.renderer, stand.camera, (2, 2), options, view)
        before, _ = upsampling.upsampled(coarse, stand.renderer, stand.camera, color, view, before)
        view = stand.sight()
    assert (before.color_array() == [51, 102, 153, 0]).all()
    assert np.isinf(before.depth_array()).all()


def test_the_box_of_a_picture_holds_all_of_its_object():
    colors = np.zeros((20, 30, 4), np.uint8)
    assert object_box(colors) is None
    colors[6, 9, 3] = colors[11, 28, 3] = 1
    assert object_box(colors) == (4, 14, 7, 30)
