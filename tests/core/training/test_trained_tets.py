"""The tets that stage 2 trains on."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.field import (
    FieldOptions,
    pack_mask,
    random_field,
    reduced,
    subtet_middles,
    unpack_mask,
)
from deformrf.core.geometry import Plane, a15_grid, extract, face_components, tet_neighbours
from deformrf.core.training import DatasetError, trained_tets
from deformrf.core.training.run.training_field import TrainingField


def test_nothing_occupied_is_said_so():
    stage = TrainingField(a15_grid(0.25), FieldOptions(level_count=2, table_size=2**8), "cpu")
    stage.occupied[:] = False
    with pytest.raises(DatasetError, match="scene box"):
        trained_tets.kept_mesh(stage)


@pytest.mark.parametrize("share, stays", [(0.8, False), (1.2, True)])
def test_floaters_are_measured_by_what_is_seen_of_them(share, stays):
    """A speck has many neighbours for its size; a few of its tets, of so many limits."""
    stage = TrainingField(a15_grid(0.05), FieldOptions(level_count=2, table_size=2**8), "cpu")
    middles = stage.mesh.rest_vertices[stage.mesh.tets].mean(axis=1)
    body, corner = middles[:, 0] < 0.5, [0.8, 0.5, 0.5]
    count = round(share * trained_tets.SMALLEST_COMPONENT * body.sum())
    speck = np.argsort(np.linalg.norm(middles - corner, axis=1))[:count]
    stage.occupied[:] = False
    stage.occupied[np.flatnonzero(body)] = True
    whole = trained_tets.kept_mesh(stage)
    stage.occupied[speck] = True
    mesh = trained_tets.kept_mesh(stage)
    more = mesh.tet_count - whole.tet_count
    assert count > 5 and more > 1.3 * count if stays else more == 0


def test_tets_that_hold_points_of_surfaces_are_kept():
    stage = TrainingField(a15_grid(0.08), FieldOptions(level_count=2, table_size=2**8), "cpu")
    middles = stage.mesh.rest_vertices[stage.mesh.tets].mean(axis=1)
    stage.occupied[:] = False
    stage.occupied[np.flatnonzero(middles[:, 0] < 0.3)] = True
    arm, lonely = (
        np.abs(middles - place).sum(axis=1).argmin() for place in ([0.44, 0.5, 0.5], [0.8] * 3)
    )
    corners = stage.mesh.rest_vertices[stage.mesh.tets]
    inside = np.random.default_rng().dirichlet(np.ones(4), 5) @ corners[arm]
    beside = [[np.nan, 0.5, 0.5], [7.0, 0.5, 0.5]]
    points = np.concatenate([inside, corners[lonely].mean(axis=0)[None], beside])

    def holds(mesh, place):
        return (
            np.linalg.norm(mesh.rest_vertices[mesh.tets].mean(axis=1) - place, axis=1).min() < 1e-6
        )

    without, mesh = trained_tets.kept_mesh(stage), trained_tets.kept_mesh(stage, points=points)
    assert not holds(without, middles[arm]) and holds(mesh, middles[arm])
    assert not holds(mesh, middles[lonely])  # a single point may be wrong


@pytest.fixture(scope="module")
def scene():
    """A hollow column on a table, a mug cut by the box's side, a speck; the column's middle."""
    mesh = a15_grid(0.04)
    middles = subtet_middles(mesh)
    x, y, z = np.moveaxis(middles, 2, 0)
    radius = np.hypot(x - 0.5, y - 0.5)
    column = (radius < 0.2) & (z > 0.05) & (z < 0.8) & ((radius > 0.13) | (z > 0.73))
    table = (abs(z - 0.05) < 0.012) & (radius > 0.2)  # what is below the column isn't seen
    mug = (x > 0.85) & (z > 0.05) & (z < 0.25) & (abs(y - 0.5) < 0.1)
    speck = np.linalg.norm(middles - [0.15, 0.5, 0.5], axis=2) < 0.03
    matter = column | table | mug | speck
    options = FieldOptions(level_count=2, table_size=2**10)
    field = random_field(mesh, tet_neighbours(mesh.tets), options)
    field.occupancy[:] = pack_mask(matter)
    return field, column


def test_the_object_is_left_alone_and_solid(scene, monkeypatch):
    field, column = scene
    # No color tells a foot.
    monkeypatch.setattr(trained_tets, "subtet_colors", lambda _, tets, __: np.ones((len(tets), 3)))
    box, ground = np.array([[0.0] * 3, [1.0] * 3]), Plane(np.array([0.0, 0.0, 1.0]), 0.05)
    densities = np.full(column.shape, 50.0)
    fog = subtet_middles(field.mesh)[..., 2] > 0.83  # thin, above the column
    field.occupancy[:] = pack_mask(unpack_mask(field.occupancy) | fog)
    densities[fog] = 1.0
    alone = trained_tets.object_alone(field, densities, box, ground)
    left = subtet_middles(alone.mesh)[unpack_mask(alone.occupancy)]
    expected = subtet_middles(field.mesh)[column]
    edge = 0.022
    assert left[:, 2].min() > 0.05 and left[:, 2].max() < 0.95
    assert (np.hypot(*(left[:, :2] - 0.5).T) < 0.2 + 1e-6).mean() > 0.995
    high = expected[:, 2] > 0.05 + edge
    assert (left[:, 2] > 0.05 + edge).sum() >= 0.99 * high.sum()
    # The column's inside is not hollow, and no tet lies below the table.
    middles, whole = (m.rest_vertices[m.tets].mean(axis=1) for m in (alone.mesh, field.mesh))

    def inside(points):
        radius = np.hypot(*(points[:, :2] - 0.5).T)
        return ((radius < 0.1) & (points[:, 2] > 0.15) & (points[:, 2] < 0.7)).sum()

    assert inside(middles) == inside(whole) > 50
    assert middles[:, 2].min() > 0.0


def test_fog_carries_no_crumbs_of_the_ground(scene):
    """Around the column the table is thicker than a layer, with fog on it."""
    field, column = scene
    box, ground = np.array([[0.0] * 3, [1.0] * 3]), Plane(np.array([0.0, 0.0, 1.0]), 0.05)
    x, y, z = np.moveaxis(subtet_middles(field.mesh), 2, 0)
    ring = abs(np.hypot(x - 0.5, y - 0.5) - 0.3) < 0.1
    crumbs, fog = ring & (z > 0.05) & (z < 0.095), ring & (z > 0.095) & (z < 0.13)
    occupancy, densities = field.occupancy.copy(), np.full(column.shape, 50.0)
    densities[fog] = 1.0
    field.occupancy[:] = pack_mask(column | crumbs | fog)
    try:
        alone = trained_tets.object_alone(field, densities, box, ground)
    finally:
        field.occupancy[:] = occupancy
    left = subtet_middles(alone.mesh)[unpack_mask(alone.occupancy)]
    beside = np.hypot(*(left[:, :2] - 0.5).T) > 0.24
    assert (left[beside, 2] < 0.095).sum() < 0.05 * crumbs.sum()
    assert (~beside).sum() > 0.9 * column.sum()


@pytest.mark.parametrize("telling", [True, False])
def test_the_end_of_a_foot_stays_if_its_color_tells(scene, monkeypatch, telling):
    """What is as high as the ground's surface, under the column, is the column's or the table's."""
    field, column = scene
    box, ground = np.array([[0.0] * 3, [1.0] * 3]), Plane(np.array([0.0, 0.0, 1.0]), 0.05)
    places = subtet_middles(field.mesh)
    radius, z = np.hypot(*np.moveaxis(places[..., :2] - 0.5, 2, 0)), places[..., 2]
    end = (abs(z - 0.05) < 0.012) & (radius > 0.14) & (radius < 0.19)

    def colors(field, tets, subtets):
        reds = np.where(telling & (radius[tets, subtets] < 0.2), 0.9, 0.1)
        return np.stack([reds, *[np.full(len(tets), 0.1)] * 2], axis=1)

    monkeypatch.setattr(trained_tets, "subtet_colors", colors)
    occupancy = pack_mask(unpack_mask(field.occupancy) | end)
    with_end = replace(field, occupancy=occupancy)
    alone = trained_tets.object_alone(with_end, np.full(column.shape, 50.0), box, ground)
    left = subtet_middles(alone.mesh)[unpack_mask(alone.occupancy)]
    low = left[left[:, 2] < 0.055]
    if telling:
        assert len(low) > 0.8 * (end & (z < 0.055) & (z > 0.045)).sum() > 50
    else:
        assert len(low) == 0
    assert (np.hypot(*(low[:, :2] - 0.5).T) < 0.21).all()


def test_without_matter_nothing_is_taken_away(scene):
    field, column = scene
    densities = np.full(column.shape, 50.0)
    box, ground = np.array([[0.0] * 3, [1.0] * 3]), Plane(np.array([0.0, 0.0, 1.0]), 5.0)
    assert trained_tets.object_alone(field, densities, box, ground) is field


BODY, WIRE, OTHER = 1, 2, 3  # parts of `spurred`


def spurred(wire_matter, length=0.6, both_ends=False):
    """A field of a block with a wire of tets in which so many sub-tets are occupied; its parts."""
    whole = a15_grid(0.05)
    x, y, z = whole.rest_vertices[whole.tets].mean(axis=1).T
    thin = (abs(y - 0.5) < 0.09) & (abs(z - 0.5) < 0.09)
    part = np.where((x < 0.25) & (abs(y - 0.5) < 0.3) & (abs(z - 0.5) < 0.3), BODY, 0)
    part[(part == 0) & thin & (x < 0.25 + length)] = WIRE
    if both_ends:
        part[x > 0.75] = OTHER
    labels = face_components(tet_neighbours(whole.tets), part > 0)
    part[labels != np.bincount(labels[labels >= 0]).argmax()] = 0
    mesh, _ = extract(whole, part > 0)
    part = part[part > 0]
    matter = np.ones((mesh.tet_count, 64), bool)
    matter[part == WIRE] = np.arange(64) < wire_matter
    field = random_field(mesh, tet_neighbours(mesh.tets), FieldOptions(2, 2**10))
    field.occupancy[:] = pack_mask(matter)
    assert len(set(face_components(field.neighbours))) == 1
    return field, part


@pytest.mark.parametrize("wire_matter", [0, 1, trained_tets.CORNER])
def test_a_chain_of_fog_goes(wire_matter):
    """All of it but what is next to the block; the block stays as it is."""
    field, part = spurred(wire_matter)
    fewer = trained_tets.without_spurs(field)
    gone = field.mesh.tet_count - fewer.mesh.tet_count
    assert trained_tets.SPUR < 0.7 * (part == WIRE).sum() < gone < (part == WIRE).sum()
    assert (unpack_mask(fewer.occupancy).sum(axis=1) == 64).sum() == (part == BODY).sum()
    assert len(set(face_components(fewer.neighbours))) == 1


def test_crumbs_without_matter_do_not_hold_a_chain():
    """The chain meets the block at edges and vertices alone; without it, what meets it crumbles."""
    field, part = spurred(0)
    mesh = field.mesh
    across = np.where(field.neighbours >= 0, part[field.neighbours], 0)
    near = np.isin(mesh.tets, mesh.tets[part == BODY]).any(axis=1) & (part == WIRE)
    middle = abs(mesh.rest_vertices[mesh.tets].mean(axis=1)[:, 1] - 0.5) < 0.04
    gone = (part == WIRE) & ((across == BODY).any(axis=1) | (near & middle))
    cut, part, near = reduced(field, ~gone), part[~gone], near[~gone]
    crumbled = face_components(cut.neighbours, (part == BODY) | near).max()
    assert crumbled > face_components(cut.neighbours).max()
    left = trained_tets.without_spurs(cut)
    assert left.mesh.tet_count == (part == BODY).sum()
    assert (unpack_mask(left.occupancy).sum(axis=1) == 64).all()


@pytest.mark.parametrize("shell_matter", [64, 0])
def test_what_an_object_encloses_stays(shell_matter):
    """A ball with matter in its shell, as no image sees the rest; without any, nothing goes."""
    whole = a15_grid(0.05)
    radius = np.linalg.norm(whole.rest_vertices[whole.tets].mean(axis=1) - 0.5, axis=1)
    mesh, _ = extract(whole, radius < 0.4)
    radius = radius[radius < 0.4]
    field = random_field(mesh, tet_neighbours(mesh.tets), FieldOptions(2, 2**10))
    is_shell = (radius > 0.3)[:, None] & (np.arange(64) < shell_matter)
    field.occupancy[:] = pack_mask(is_shell)
    assert (radius < 0.2).sum() > 5 * trained_tets.SPUR
    assert trained_tets.without_spurs(field) is field


def test_a_wire_a_bridge_and_a_stub_stay():
    """Matter in more than a corner of its tets; what joins two parts; few tets."""
    for field, _ in (
        spurred(trained_tets.CORNER + 1),
        spurred(1, both_ends=True),
        spurred(1, length=0.1),
    ):
        assert trained_tets.without_spurs(field) is field
