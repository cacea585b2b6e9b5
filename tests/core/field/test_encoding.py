"""The encoding: continuous, addressed exactly, and its kernels equal the reference.

The spatial hash: known values, exact integers, the same in kernels.
"""

import numpy as np
import pytest
import warp as wp

from deformrf.core.base.wide import vec4h
from deformrf.core.definition.encoding import encode, hash_address
from deformrf.core.field import FEATURES, encode_backward_kernel, encode_kernel, make_tables
from deformrf.core.field.layout import dense_ids, encoding_of, hash_entry, make_layout
from deformrf.core.geometry import a15_grid, path_nodes, tet_neighbours
from deformrf.core.geometry.mesh import FACES

LEVELS, TABLE_SIZE, COUNT = 6, 2**12, 5000


@pytest.fixture(scope="module")
def mesh():
    return a15_grid(0.12)


@pytest.fixture(scope="module")
def layout(mesh):
    return make_layout(mesh, LEVELS, TABLE_SIZE)


def random_samples(mesh):
    rng = np.random.default_rng()
    tet = rng.integers(0, mesh.tet_count, COUNT).astype(np.int32)
    return tet, rng.dirichlet(np.ones(4), COUNT)


def random_table(layout):
    return np.random.default_rng().normal(size=(layout.offsets[-1], FEATURES))


def test_some_levels_are_dense_and_the_rest_hashed(layout):
    assert 1 <= layout.dense_level_count < LEVELS
    hashed = layout.entry_counts[layout.dense_level_count :]
    assert set(hashed) == {TABLE_SIZE}
    assert all(n <= TABLE_SIZE for n in layout.entry_counts)


def test_without_dense_levels_all_are_hashed(mesh):
    """Also the ones that would fit; and the kernel still finds every entry."""
    layout = make_layout(mesh, 3, TABLE_SIZE, dense_levels=False)
    assert layout.entry_counts == (TABLE_SIZE,) * 3
    assert (layout.dense_level_count, layout.node_ids) == (0, ())
    check_forward_kernel(mesh, layout, "cpu")


@pytest.mark.parametrize("level", [0, 1, 2])
def test_dense_entries_are_one_to_one_with_vertices(mesh, level):
    ids, count = dense_ids(mesh, level)
    nodes, _ = path_nodes(level)
    addresses = np.einsum("nc,tcx->tnx", nodes, mesh.addresses[mesh.tets]).reshape(-1, 3)
    assert len(np.unique(addresses, axis=0)) == count == ids.max() + 1
    pairs = np.unique(np.column_stack([ids.ravel(), addresses]), axis=0)
    assert len(pairs) == count


def test_features_are_continuous_across_faces(mesh, layout):
    """The same point of a shared face, seen from both tets, at every level."""
    neighbours = tet_neighbours(mesh.tets)
    tet, face = (a[:COUNT] for a in np.nonzero(neighbours >= 0))
    other = neighbours[tet, face]
    beta = np.random.default_rng().dirichlet(np.ones(3), len(tet))
    rows = np.arange(len(tet))
    first, second = np.zeros((len(tet), 4)), np.zeros((len(tet), 4))
    for j in range(3):
        corner = FACES[face, j]
        first[rows, corner] = beta[:, j]
        there = (mesh.tets[other] == mesh.tets[tet, corner][:, None]).argmax(axis=1)
        second[rows, there] = beta[:, j]
    table = random_table(layout)
    np.testing.assert_allclose(
        encode(encoding_of(mesh, layout, table), tet, first),
        encode(encoding_of(mesh, layout, table), other, second),
        atol=1e-9,
    )


def test_level_zero_interpolates_the_corner_features(mesh, layout):
    tet, bary = random_samples(mesh)
    table = random_table(layout)
    order = np.lexsort(mesh.addresses.T[::-1])
    entry = np.argsort(order)[mesh.tets[tet]]
    expected = np.einsum("nc,ncf->nf", bary, table[entry])
    features = encode(encoding_of(mesh, layout, table), tet, bary)
    np.testing.assert_allclose(features[:, :FEATURES], expected)


def entry_type(entry):
    return np.float32 if entry is wp.vec4 else np.float16


def launch_arguments(mesh, layout, tet, bary, device):
    return (
        make_tables(mesh, layout, device),
        wp.array(tet, dtype=int, device=device),
        wp.array(bary.astype(np.float32), dtype=wp.vec4, device=device),
    )


@pytest.mark.parametrize("entry", [wp.vec4, vec4h])
def test_forward_kernel_matches_the_reference(mesh, layout, device, entry):
    check_forward_kernel(mesh, layout, device, entry)


def check_forward_kernel(mesh, layout, device, entry=wp.vec4):
    levels = layout.level_count
    tet, bary = random_samples(mesh)
    table = random_table(layout).astype(entry_type(entry))
    tables, tet_array, bary_array = launch_arguments(mesh, layout, tet, bary, device)
    table_array = wp.array(table, dtype=entry, device=device)
    features = wp.empty((COUNT, levels), dtype=entry, device=device)
    wp.launch(
        encode_kernel,
        dim=COUNT,
        inputs=[tables, table_array, tet_array, bary_array, levels],
        outputs=[features],
        device=device,
    )
    expected = encode(encoding_of(mesh, layout, table.astype(float)), tet, bary)
    # Each level doubles the rounding error of bary: 2^5 · 6e-8, times features of size 4.
    # Half precision then rounds once more: half of 2^-10.
    relative = 0.0 if entry is wp.vec4 else 2.0**-11
    np.testing.assert_allclose(
        features.numpy().reshape(COUNT, -1), expected, rtol=relative, atol=5e-5
    )


@pytest.mark.parametrize("entry", [wp.vec4, vec4h])
def test_backward_kernel_is_the_adjoint_of_the_reference(mesh, layout, device, entry):
    """<g, encode(table)> = <encode*(g), table> for every table: encode is linear in it."""
    tet, bary = random_samples(mesh)
    gradient = np.random.default_rng().normal(size=(COUNT, LEVELS, FEATURES))
    gradient = gradient.astype(entry_type(entry))
    tables, tet_array, bary_array = launch_arguments(mesh, layout, tet, bary, device)
    table_grad = wp.zeros(int(layout.offsets[-1]), dtype=wp.vec4, device=device)
    gradient_array = wp.array(gradient, dtype=entry, device=device)
    wp.launch(
        encode_backward_kernel,
        dim=COUNT,
        inputs=[tables, tet_array, bary_array, gradient_array],
        outputs=[table_grad],
        device=device,
    )
    gradient = gradient.astype(float)
    for _ in range(3):
        table = random_table(layout)
        features = encode(encoding_of(mesh, layout, table), tet, bary)
        expected = (features * gradient.reshape(COUNT, -1)).sum()
        scale = np.abs(features * gradient.reshape(COUNT, -1)).sum()
        assert abs((table_grad.numpy() * table).sum() - expected) < 1e-5 * scale


def test_wrong_sizes_are_named(mesh):
    with pytest.raises(ValueError, match="3000"):
        make_layout(mesh, LEVELS, 3000)
    with pytest.raises(ValueError, match="11"):
        make_layout(mesh, 11, TABLE_SIZE)


def test_it_is_instant_ngps_formula_in_exact_integers():
    for x, y, z in [(0, 0, 0), (1, 2, 3), (1023, 7, 500_000)]:
        exact = (x ^ (y * 2654435761) ^ (z * 805459861)) % 2**32
        assert hash_address(np.array([x, y, z]), 2**18) == exact % 2**18


@wp.kernel
def hash_kernel(addresses: wp.array(dtype=wp.vec3i), mask: int, entries: wp.array(dtype=int)):
    n = wp.tid()
    entries[n] = hash_entry(addresses[n], mask)


def test_kernel_matches_numpy(device):
    addresses = np.random.default_rng().integers(0, 2**20, (5000, 3)).astype(np.int32)
    entries = wp.empty(5000, dtype=int, device=device)
    inputs = [wp.array(addresses, dtype=wp.vec3i, device=device), 2**19 - 1]
    wp.launch(hash_kernel, dim=5000, inputs=inputs, outputs=[entries], device=device)
    np.testing.assert_array_equal(entries.numpy(), hash_address(addresses, 2**19))


def test_the_lattice_fills_the_buckets_like_random_numbers():
    """Vertices of a deep level, hashed at that level's scale, leave no bucket out of reach."""
    mesh = a15_grid(0.12)
    nodes, _ = path_nodes(3)
    addresses = np.einsum("nc,tcx->tnx", nodes, mesh.addresses[mesh.tets]).reshape(-1, 3)
    addresses = np.unique(addresses, axis=0)
    entry_count = 2 ** int(np.log2(len(addresses)))
    hit = len(np.unique(hash_address(addresses, entry_count)))
    random = entry_count * (1.0 - np.exp(-len(addresses) / entry_count))
    assert hit > 0.95 * random
