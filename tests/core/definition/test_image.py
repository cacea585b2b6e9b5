"""The image: as the renderer before drew it, and facts that follow from its four lines."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.core.definition import image
from deformrf.core.field import load
from deformrf.core.render import camera_rays, from_field_of_view, look_at

# Of the bundled model, 64×64 pixels, colors and opacity times 65535: drawn by the float64 renderer
# that was there before core/definition.
GOLDEN = np.load(Path(__file__).parents[2] / "golden/definition_images.npz")
SIZE, BACKGROUND, TOLERANCE = 64, (0.2, 0.5, 0.9), 0.01 / 255.0
PIXELS = 120  # of each picture, other ones with each DEFORMRF_TEST_SEED; all take minutes


@pytest.fixture(scope="module")
def bundled():
    return load(DEFAULT_MODEL).definition


def about_z(x, angle):
    c, s = np.cos(angle), np.sin(angle)
    a, b = x[:, 0] - 0.5, x[:, 1] - 0.5
    return np.stack([0.5 + c * a - s * b, 0.5 + s * a + c * b, x[:, 2]], axis=1)


def height(x):
    """From 0 to 1."""
    return (x[:, 2] - x[:, 2].min()) / np.ptp(x[:, 2])


def twisted(turns):
    return lambda x: about_z(x, 2.0 * np.pi * turns * height(x))


def bent(degrees):
    """Around an axis behind the object, or in it: then its inner side turns inside out."""

    def pose(x):
        angle, radius = np.radians(degrees) * height(x), np.ptp(x[:, 2]) / np.radians(degrees)
        radius = radius - (x[:, 0] - 0.5)
        return np.stack([0.5 - radius * np.cos(angle), x[:, 1], radius * np.sin(angle)], axis=1)

    return pose


def scaled(*factors):
    return lambda x: 0.5 + (x - 0.5) * factors


def torn(x):
    """Every vertex moved by two thirds of an edge: a third of the tets is inside out."""
    away = np.random.default_rng(48).normal(size=x.shape)
    return x + 0.03 * away / np.linalg.norm(away, axis=1, keepdims=True)


def pushed_in(x):
    """Its right half moved to the left, into the other."""
    return x - np.where(x[:, :1] > 0.5, 0.15, 0.0) * [1.0, 0.0, 0.0]


POSES = {
    "rest": scaled(1.0, 1.0, 1.0),
    "turned": lambda x: about_z(about_z(x, 0.7)[:, [2, 0, 1]], 0.4),
    "mirrored": scaled(-1.0, 1.0, 1.0),
    "bent by 90": bent(90.0),
    "bent by 180": bent(180.0),
    "twisted once": twisted(1.0),
    "squashed": scaled(1.0, 1.0, 0.1),
    "stretched": scaled(1.0, 1.0, 3.0),
    "torn": torn,
    "pushed in": pushed_in,
}


def rays(vertices):
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    center, radius = 0.5 * (low + high), 0.5 * np.linalg.norm(high - low)
    eye = center + 3.0 * radius * np.array([0.48, -0.8, 0.36])
    return camera_rays(from_field_of_view(look_at(eye, center), 0.6, SIZE, SIZE))


@pytest.mark.parametrize("picture", GOLDEN.files)
def test_the_bundled_model_is_drawn_as_before(bundled, picture):
    """Half of the pixels show the model; files of versions 1 and 2 have a color for each sample."""
    pose, color = picture.split("/")
    field = replace(bundled, color_per_ray=color == "ray")
    expected = GOLDEN[picture] / 65535.0
    random, seen = np.random.default_rng(), np.flatnonzero(expected[:, 3] > 0.0)
    some = np.append(random.choice(seen, PIXELS // 2), random.choice(SIZE * SIZE, PIXELS // 2))
    vertices = POSES[pose](field.rest_vertices)
    origins, directions = rays(vertices)
    found, opacity, _ = image.render_rays(
        field, vertices, origins[some], directions[some], BACKGROUND
    )
    difference = np.abs(np.column_stack([found, opacity]) - expected[some])
    assert difference.max() <= TOLERANCE
    assert (opacity > 0.5).mean() > 0.05


def test_pieces_of_a_ray_are_one_step_long_but_for_the_last_of_each_tet(make_ball_field):
    field = make_ball_field(3, occupied_share=1.0).definition
    vertices = POSES["stretched"](field.rest_vertices)
    direction = np.array([[0.48, -0.8, 0.36]])
    pieces = image.ray_pieces(field, vertices, 0.5 - 2.0 * direction, direction)
    lengths = (pieces.t_out - pieces.t_in) * pieces.rate  # no tet has faded
    last = np.append(pieces.tet[1:] != pieces.tet[:-1], True)
    np.testing.assert_allclose(lengths[~last], field.piece_length)
    assert (lengths[last] <= field.piece_length * (1 + 1e-9)).all()
    assert (~last).sum() > 10


def test_weights_add_up_to_what_is_absorbed():
    tau = np.random.default_rng().exponential(size=50)
    assert image.weights(tau).sum() == pytest.approx(1.0 - np.exp(-tau.sum()))


def test_where_two_media_overlap_their_extinctions_add_up():
    """Of 1 and 3 per unit over the same interval: 1 − exp(−4), and colors in that proportion."""
    kappa, values = np.array([1.0, 3.0]), np.array([[1.0], [0.0]])
    sums, opacity, depth = image.sum_along(kappa, values, np.zeros(2), np.ones(2))
    assert opacity == pytest.approx(1.0 - np.exp(-4.0))
    assert sums[0] == pytest.approx(0.25 * opacity)
    assert depth == pytest.approx(0.5)
