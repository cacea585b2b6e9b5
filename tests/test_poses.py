"""The image is the defined one in every pose: folded, inverted, flat, and seen from inside."""

import numpy as np
import pytest

from deformrf.core.geometry.mesh import edges, face_components, signed_volumes
from deformrf.core.render import reference
from deformrf.core.render.camera import from_field_of_view, look_at, rays
from deformrf.core.render.render import Renderer, RenderOptions

BACKGROUND = (0.2, 0.5, 0.9)
SIZE = 100  # pixels
CONFORMANCE = RenderOptions(BACKGROUND, conformance=True)
TWO_PARTS = "parts in each other"


def about_z(x, angle):
    c, s = np.cos(angle), np.sin(angle)
    a, b = x[:, 0] - 0.5, x[:, 1] - 0.5
    return np.stack([0.5 + c * a - s * b, 0.5 + s * a + c * b, x[:, 2]], axis=1)


def rigid(x, mesh):
    turned = about_z(x, 0.7)
    return about_z(turned[:, [2, 0, 1]] + [0.05, -0.03, 0.02], 0.4)


def twist(degrees):
    def pose(x, mesh):
        low, high = x[:, 2].min(), x[:, 2].max()
        return about_z(x, np.radians(degrees) * (x[:, 2] - low) / (high - low))

    return pose


def bend(x, mesh):
    """By 180 degrees around an axis inside the object, whose inner side turns inside out."""
    low, high = x[:, 2].min(), x[:, 2].max()
    angle = np.pi * (x[:, 2] - low) / (high - low)
    radius = (high - low) / np.pi + (x[:, 0] - 0.5)
    return np.stack([0.5 - radius * np.cos(angle), x[:, 1], 0.5 + radius * np.sin(angle)], axis=1)


def scaled(x, y, z):
    return lambda points, mesh: 0.5 + (points - 0.5) * [x, y, z]


def parts_in_each_other(x, mesh):
    """Each part moved towards the other by 0.15: they share a third of their width."""
    return x - np.sign(x[:, :1] - 0.5) * [0.15, 0.0, 0.0]


def inverted_tet(x, mesh):
    """A vertex inside the mesh pushed through the opposite face of one of its tets."""
    rng = np.random.default_rng()
    tet = rng.choice(np.flatnonzero(np.linalg.norm(x[mesh.tets].mean(axis=1) - 0.5, axis=1) < 0.2))
    moved = x.copy()
    moved[mesh.tets[tet, 0]] += 1.6 * (x[mesh.tets[tet, 1:]].mean(axis=0) - x[mesh.tets[tet, 0]])
    assert signed_volumes(moved, mesh.tets)[tet] < 0.0
    return moved


def jittered(share):
    """Every vertex moved, by a share of the edges' mean length."""

    def pose(x, mesh):
        a, b = x[edges(mesh.tets)].swapaxes(0, 1)
        length = np.linalg.norm(a - b, axis=1).mean()
        away = np.random.default_rng().normal(size=x.shape)
        return x + share * length * away / np.linalg.norm(away, axis=1, keepdims=True)

    return pose


def flattened(thickness):
    def pose(x, mesh):
        height = x[:, 2].max() - x[:, 2].min()
        return 0.5 + (x - 0.5) * [1.0, 1.0, thickness / height]

    return pose


POSES = {
    "rest": scaled(1.0, 1.0, 1.0),
    "rigid": rigid,
    "mirrored": scaled(-1.0, 1.0, 1.0),
    "twist 90": twist(90.0),
    "twist 360": twist(360.0),
    "bend 180": bend,
    "squash": scaled(1.0, 1.0, 0.1),
    "small": scaled(0.1, 0.1, 0.1),
    "stretch": scaled(1.0, 1.0, 4.0),
    TWO_PARTS: parts_in_each_other,
    "inverted tet": inverted_tet,
    "jittered": jittered(0.3),
    "torn up": jittered(0.7),
    "thickness 0.02": flattened(0.02),
    "plane": flattened(0.0),
    "point": scaled(0.0, 0.0, 0.0),
    "camera inside": scaled(1.0, 1.0, 1.0),
}
INVISIBLE = ("plane", "point")  # all tets are faded out
FOLDED = ("bend 180", TWO_PARTS, "inverted tet", "torn up")
UNFOLDED = ("rest", "rigid", "mirrored", "twist 90", "squash", "small", "stretch", "camera inside")


def view_of(vertices, from_inside):
    """A random view of the whole object, or one from a place inside it."""
    rng = np.random.default_rng()
    direction = rng.normal(size=3) * [1.0, 1.0, 0.5]
    direction /= np.linalg.norm(direction)
    center = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = max(0.01, 0.5 * np.linalg.norm(np.ptp(vertices, axis=0)))
    distance = 0.2 * radius if from_inside else 3.4 * radius
    eye = center + distance * direction
    return from_field_of_view(look_at(eye, center - direction), 0.6, SIZE, SIZE)


@pytest.fixture
def posed(make_ball_field, device):
    """Make a field in a pose: the field, its vertices, rays, and a renderer in that pose."""

    def make(pose):
        seed = int(np.random.default_rng().integers(10_000))
        field = make_ball_field(seed, gap=0.05 if pose == TWO_PARTS else 0.0)
        vertices = POSES[pose](field.mesh.rest_vertices, field.mesh).astype(np.float32)
        view = view_of(vertices.astype(float), pose == "camera inside")
        # Rounded first: both renderers are to be given the same rays.
        origins, directions = (a.astype(np.float32).astype(float) for a in rays(view))
        renderer = Renderer(field, device)
        renderer.set_vertices(vertices)
        return field, vertices, (origins, directions), renderer

    return make


@pytest.mark.parametrize("pose", POSES)
def test_every_pose_renders_as_defined(assert_conforms, posed, pose):
    field, vertices, both, renderer = posed(pose)
    expected, expected_opacity, _ = reference.render_rays(field, vertices, *both, BACKGROUND)
    seen = expected_opacity.mean()
    assert seen < 1e-6 if pose in INVISIBLE else seen > 2e-3
    color, opacity, _ = renderer.render_rays(*both, CONFORMANCE)
    assert_conforms(color, expected, field, vertices, *both, BACKGROUND)
    assert np.abs(opacity - expected_opacity).mean() < 1e-3
    default, _, _ = renderer.render_rays(*both, RenderOptions(BACKGROUND))
    assert np.isfinite(default).all()
    assert -10 * np.log10(np.mean((default - expected) ** 2) + 1e-12) > 45.0


@pytest.mark.parametrize("pose", (*FOLDED, *UNFOLDED))
def test_only_what_overlaps_takes_the_long_way(posed, pose):
    _, _, both, renderer = posed(pose)
    stages = renderer.stage_seconds = {}
    renderer.render_rays(*both, CONFORMANCE)
    assert ("layers" in stages) == (pose in FOLDED)


def test_a_part_inside_another_is_noticed(make_ball_field, device):
    """No boundary edge crosses a face then."""
    field = make_ball_field(1, gap=0.05)
    part = face_components(field.neighbours)
    small = np.unique(field.mesh.tets[part == part[0]])
    vertices = field.mesh.rest_vertices.copy()
    other = np.setdiff1d(np.arange(len(vertices)), small)
    center = vertices[other].mean(axis=0)
    vertices[small] = center + 0.05 * (vertices[small] - vertices[small].mean(axis=0))
    renderer = Renderer(field, device)
    renderer.set_vertices(vertices)
    assert renderer.tangle().shells
    renderer.set_vertices(field.mesh.rest_vertices)
    assert not renderer.tangle()
