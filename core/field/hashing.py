"""The spatial hash of an integer address: one definition, exact integers only.

Instant-NGP's hash, Eq. 4 (Müller et al. 2022): (x·1) xor (y·2654435761) xor
(z·805459861) in uint32, then masked to a table of 2^n entries.
"""

import numpy as np
import warp as wp

PRIMES = (1, 2654435761, 805459861)
_PRIME_Y = wp.constant(wp.uint32(PRIMES[1]))
_PRIME_Z = wp.constant(wp.uint32(PRIMES[2]))


def hash_products(addresses):
    """Coordinates times their primes, linear in the address modulo 2^32.

    [..., 3] int -> [..., 3] uint32
    """
    return np.asarray(addresses).astype(np.uint32) * np.array(PRIMES, np.uint32)


def hash_address(addresses, entry_count: int):
    """Entry of each address in a table.  [..., 3] int -> [...] int64

    `entry_count` is a power of two.
    """
    product = hash_products(addresses)
    hashed = product[..., 0] ^ product[..., 1] ^ product[..., 2]
    return (hashed & np.uint32(entry_count - 1)).astype(np.int64)


@wp.func
def products_entry(products: wp.vec3ui, mask: int):
    """Entry of the address with these `hash_products`."""
    return int((products[0] ^ products[1] ^ products[2]) & wp.uint32(mask))


@wp.func
def hash_entry(address: wp.vec3i, mask: int):
    """Entry of an address in a table of mask + 1 entries, a power of two."""
    return products_entry(
        wp.vec3ui(
            wp.uint32(address[0]),
            wp.uint32(address[1]) * _PRIME_Y,
            wp.uint32(address[2]) * _PRIME_Z,
        ),
        mask,
    )
