"""Reached entries: the kernel equals the definition, and the others are never read."""

from itertools import pairwise

import numpy as np
import pytest
import warp as wp

from deformrf.core.definition import networks
from deformrf.core.definition.encoding import encode, hash_address
from deformrf.core.field import (
    encode_kernel,
    is_occupied,
    make_tables,
    reach,
    reached_entries,
    subtet_of,
    unpack_mask,
)
from deformrf.core.field.layout import encoding_of
from deformrf.core.field.reach import occupied_cells
from deformrf.core.geometry import path_corners, path_nodes

LEVELS = 5  # with 2^12 entries the last two are hashed, with 2^8 all but the first or none


def random_field(make_ball_field, table_size=2**12, occupied_share=None):
    rng = np.random.default_rng()
    share = rng.uniform(0.05, 0.5) if occupied_share is None else occupied_share
    return make_ball_field(
        rng.integers(1000), occupied_share=share, level_count=LEVELS, table_size=table_size
    )


def reached_reference(mesh, layout, occupancy):
    """The definition, for small meshes: every corner of every such descendant.

    [T] uint64 -> [entries] bool, the levels one after another as in the table.
    """
    reached = np.zeros(layout.offsets[-1], bool)
    for level in range(layout.level_count):
        tet, path = np.nonzero(occupied_cells(occupancy, level))
        if level < layout.dense_level_count:
            entry = layout.node_ids[level][tet[:, None], path_nodes(level)[1][path]]
        else:
            coarse = mesh.addresses[mesh.tets[tet]].astype(np.int64)  # [S, 4, 3]
            corners = path_corners(level)[path] @ coarse
            entry = hash_address(corners, layout.entry_counts[level])
        reached[layout.offsets[level] + entry] = True
    return reached


@pytest.mark.parametrize("table_size", [2**7, 2**12, 2**17])
def test_the_kernel_equals_the_definition(make_ball_field, device, table_size):
    field = random_field(make_ball_field, table_size)
    arguments = field.mesh, field.layout, field.occupancy
    np.testing.assert_array_equal(
        reached_entries(*arguments, device=device), reached_reference(*arguments)
    )


def test_small_launches_find_the_same_entries(make_ball_field, monkeypatch):
    """The search of a level ends early if there is nothing left to find."""
    field = random_field(make_ball_field, 2**9)
    arguments = field.mesh, field.layout, field.occupancy
    monkeypatch.setattr(reach, "NODES_PER_LAUNCH", 1000)
    np.testing.assert_array_equal(reached_entries(*arguments), reached_reference(*arguments))


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_an_empty_field_reaches_nothing_and_a_full_one_every_vertex(make_ball_field, share):
    field = random_field(make_ball_field, occupied_share=share)
    reached = reached_entries(field.mesh, field.layout, field.occupancy)
    dense = reached[: field.layout.offsets[field.layout.dense_level_count]]
    assert len(dense) > 0
    assert (dense == (share == 1.0)).all()
    assert reached.any() == (share == 1.0)


def test_cells_are_the_ancestors_and_descendants_of_occupied_sub_tets(make_ball_field):
    occupancy = random_field(make_ball_field).occupancy
    occupied = unpack_mask(occupancy)
    for level in range(LEVELS):
        paths = np.arange(8**level)
        cells = occupied_cells(occupancy, level)
        if level >= 2:
            expected = occupied[:, paths // 8 ** (level - 2)]
        else:
            expected = np.stack(
                [occupied[:, np.arange(64) // 8 ** (2 - level) == p].any(axis=1) for p in paths],
                axis=1,
            )
        np.testing.assert_array_equal(cells, expected)


def samples_in_occupied_subtets(field, count):
    rng = np.random.default_rng()
    tet, path = np.nonzero(unpack_mask(field.occupancy))
    chosen = rng.integers(len(tet), size=count)
    inside = rng.dirichlet(np.full(4, 0.5), size=count)  # often close to a face or a corner
    corners = path_corners(2)[path[chosen]] / 4
    return tet[chosen].astype(np.int32), np.einsum("nc,ncb->nb", inside, corners)


def test_entries_that_are_not_reached_are_never_read(make_ball_field):
    """NaN there would spread to any feature that reads it, even with weight 0."""
    field = random_field(make_ball_field)
    tet, bary = samples_in_occupied_subtets(field, 20_000)
    keep = networks.is_occupied(field.occupancy, tet, bary)  # rounding may cross a face
    tet, bary = tet[keep], bary[keep]
    assert len(tet) > 19_000
    reached = reached_entries(field.mesh, field.layout, field.occupancy)
    offsets = field.layout.offsets
    assert all(reached[a:b].any() for a, b in pairwise(offsets[:4]))
    assert not reached[offsets[2] : offsets[3]].all()  # of the first levels it may be all
    spoiled = np.where(reached[:, None], field.table, np.nan)
    np.testing.assert_array_equal(
        encode(encoding_of(field.mesh, field.layout, spoiled), tet, bary),
        encode(encoding_of(field.mesh, field.layout, field.table), tet, bary),
    )


@wp.kernel
def occupied_kernel(
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    sample_tet: wp.array(dtype=int),  # [N]
    sample_bary: wp.array(dtype=wp.vec4),  # [N]
    occupied: wp.array(dtype=wp.bool),  # [N] out
):
    """As rendering asks; in float32 a point close to a face may be on its other side."""
    n = wp.tid()
    occupied[n] = is_occupied(occupancy[sample_tet[n]], subtet_of(sample_bary[n]))


def test_features_are_the_same_without_the_other_entries(make_ball_field, device):
    field = random_field(make_ball_field)
    tet, bary = samples_in_occupied_subtets(field, 20_000)
    occupancy = wp.array(field.occupancy, dtype=wp.uint64, device=device)
    tet_array = wp.array(tet, dtype=int, device=device)
    bary_array = wp.array(bary.astype(np.float32), dtype=wp.vec4, device=device)
    occupied = wp.empty(len(tet), dtype=wp.bool, device=device)
    wp.launch(
        occupied_kernel,
        dim=len(tet),
        inputs=[occupancy, tet_array, bary_array],
        outputs=[occupied],
        device=device,
    )
    occupied = occupied.numpy()
    assert occupied.mean() > 0.95
    reached = reached_entries(field.mesh, field.layout, field.occupancy)
    tables = make_tables(field.mesh, field.layout, device)
    results = []
    for table in (field.table, np.where(reached[:, None], field.table, np.float32(0.0))):
        features = wp.empty((len(tet), LEVELS), dtype=wp.vec4, device=device)
        wp.launch(
            encode_kernel,
            dim=len(tet),
            inputs=[
                tables,
                wp.array(table, dtype=wp.vec4, device=device),
                tet_array,
                bary_array,
                LEVELS,
            ],
            outputs=[features],
            device=device,
        )
        results.append(features.numpy()[occupied])
    # On a sub-tet's face, as float32 has it, a corner beyond has a weight of a rounding.
    np.testing.assert_allclose(*results, rtol=0.0, atol=2e-6 * np.abs(field.table).max())
    assert (results[0] == results[1]).mean() > 0.999
