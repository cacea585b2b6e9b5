"""The image is the defined one in every pose: folded, inverted, flat, and seen from inside."""

import numpy as np
import pytest

from deformrf.core.definition.image import render_rays
from deformrf.core.field import FieldOptions, random_field
from deformrf.core.geometry import (
    TetMesh,
    a15_grid,
    edges,
    extract,
    face_components,
    signed_volumes,
    tet_neighbours,
)
from deformrf.core.render import (
    Renderer,
    RenderOptions,
    camera_rays,
    default_stop,
    from_field_of_view,
    look_at,
)

BACKGROUND = (0.2, 0.5, 0.9)
SIZE = 64  # pixels
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


def psnr(image, expected):
    return -10 * np.log10(np.mean((image - expected) ** 2) + 1e-12)


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
        origins, directions = (a.astype(np.float32).astype(float) for a in camera_rays(view))
        renderer = Renderer(field, device)
        renderer.set_vertices(vertices)
        return field, vertices, view, (origins, directions), renderer

    return make


@pytest.mark.parametrize("pose", POSES)
def test_every_pose_renders_as_defined(assert_conforms, posed, pose):
    field, vertices, view, both, renderer = posed(pose)
    expected, expected_opacity, _ = render_rays(field.definition, vertices, *both, BACKGROUND)
    seen = expected_opacity.mean()
    assert seen < 1e-6 if pose in INVISIBLE else seen > 2e-3
    color, opacity, _ = renderer.render_rays(*both, CONFORMANCE)
    assert_conforms(color, expected, field, vertices, *both, BACKGROUND)
    assert np.abs(opacity - expected_opacity).mean() < 1e-3
    options = RenderOptions(BACKGROUND)
    default, _, _ = renderer.render_rays(*both, options)
    assert np.isfinite(default).all()
    if not renderer.device.is_cuda:  # half precision adds to it
        # All that is behind the ends of rays.
        behind = default_stop(False) + default_stop(False, conformance=True)
        assert np.abs(default - color).max() < behind
    # From inside all rays end early, and random contents are not alike behind and before.
    least = 42.0 if pose == "camera inside" else 45.0
    assert psnr(default, expected) > least
    image = renderer.render(view, options).color_array()  # CUDA: in slots
    assert psnr(image[..., :3].reshape(-1, 3) / 255.0, expected) > least


@pytest.mark.parametrize("pose", (*FOLDED, *UNFOLDED))
def test_rays_are_merged_only_where_the_mesh_overlaps(posed, pose):
    _, _, _, both, renderer = posed(pose)
    stages = renderer.stage.seconds = {}
    renderer.render_rays(*both, CONFORMANCE)
    assert ("merge" in stages) == (pose in FOLDED)


@pytest.fixture
def assert_noticed(device):
    """The renderer notices that tets overlap, and rays around a point equal the reference."""

    def check(field, vertices, center, spread):
        vertices = vertices.astype(np.float32)
        renderer = Renderer(field, device)
        assert not renderer.overlap.exists()
        renderer.set_vertices(vertices)
        assert renderer.overlap.exists()
        rng = np.random.default_rng()
        directions = rng.normal(size=(300, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        origins = center + spread * rng.normal(size=(300, 3)) - 2.0 * directions
        both = [a.astype(np.float32).astype(float) for a in (origins, directions)]
        color, _, _ = renderer.render_rays(*both, CONFORMANCE)
        expected, opacity, _ = render_rays(field.definition, vertices, *both, BACKGROUND)
        assert opacity.mean() > 0.1
        # Rounding may explain a ray that slips along a face or a mask's edge.
        assert (np.abs(color - expected).max(axis=1) > 2.0 / 255.0).sum() <= 2
        renderer.set_vertices(field.mesh.rest_vertices)
        assert not renderer.overlap.exists()

    return check


def solid_field(mesh):
    options = FieldOptions(2, 2**10, (16,), (16,), march_step=0.01)
    return random_field(mesh, tet_neighbours(mesh.tets), options)


def test_a_part_inside_another_is_noticed(make_ball_field, assert_noticed):
    """No boundary edge crosses a face."""
    field = make_ball_field(1, gap=0.05, occupied_share=1.0)
    part = face_components(field.neighbours)
    small = np.unique(field.mesh.tets[part == part[0]])
    vertices = field.mesh.rest_vertices.copy()
    other = np.setdiff1d(np.arange(len(vertices)), small)
    center = vertices[other].mean(axis=0)
    vertices[small] = center + 0.05 * (vertices[small] - vertices[small].mean(axis=0))
    assert_noticed(field, vertices, center, 0.02)


@pytest.mark.parametrize("cells", [1.0, 1.5, 2.12])
def test_blocks_slid_into_each_other_are_noticed(assert_noticed, cells):
    """Also by whole and half cells of their lattice, where edges and faces only touch."""
    grid = a15_grid(0.0625)
    middles = grid.rest_vertices[grid.tets].mean(axis=1)
    left, right = middles[:, 0] < 0.25, (middles[:, 0] > 0.5) & (middles[:, 0] < 1.0)
    mesh, _ = extract(grid, (left | right) & (middles[:, 1:] < 0.5).all(axis=1))
    vertices = mesh.rest_vertices.copy()
    moved = np.unique(mesh.tets[mesh.rest_vertices[mesh.tets].mean(axis=1)[:, 0] > 0.4])
    vertices[moved, 0] -= 0.25 + 0.25 * cells
    assert_noticed(solid_field(mesh), vertices, np.array([0.2, 0.25, 0.25]), 0.08)


def test_a_part_folded_over_the_vertex_that_it_hangs_on_is_noticed(assert_noticed):
    """All its edges begin at that vertex, so none crosses a face without a common vertex."""
    grid = a15_grid(0.125)
    middles = grid.rest_vertices[grid.tets].mean(axis=1)
    block, _ = extract(grid, np.abs(middles - 0.5).max(axis=1) < 0.3)
    hinge = np.argmax(block.rest_vertices @ [1.0, 1.1, 1.2])  # a corner
    corner = block.rest_vertices[hinge]
    outwards = (corner - 0.5) / np.linalg.norm(corner - 0.5)
    across = np.linalg.svd(outwards[None])[2][1:]  # two directions
    triangle = np.array([[1.0, 0.0], [-0.5, 0.8], [-0.5, -0.8]]) @ across
    count = len(block.rest_vertices)
    rest = np.concatenate([block.rest_vertices, corner + 0.1 * outwards + 0.03 * triangle])
    tet = np.array([[hinge, count, count + 1, count + 2]], np.int32)
    if signed_volumes(rest, tet)[0] < 0.0:
        tet = tet[:, [0, 2, 1, 3]]
    addresses = np.concatenate([block.addresses, block.addresses[:3] + 1000]).astype(np.int32)
    mesh = TetMesh(rest, addresses, np.concatenate([block.tets, tet]).astype(np.int32))
    half_turn = 2.0 * np.outer(across[0], across[0]) - np.eye(3)
    folded = rest.copy()
    folded[count:] = corner + (rest[count:] - corner) @ half_turn.T
    assert_noticed(solid_field(mesh), folded, folded[count:].mean(axis=0), 0.02)
