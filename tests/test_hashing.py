"""The spatial hash: known values, exact integers, the same in kernels."""

import numpy as np
import warp as wp

from deformrf.core.field.hashing import hash_address, hash_entry
from deformrf.core.geometry import a15_grid, path_nodes


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
