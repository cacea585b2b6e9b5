"""List the contacts in the order of samples, and for each vertex its contacts.

The order does not depend on the timing of threads, so a repeated frame gives the same bits.

Shapes: V vertices, S samples, N contacts.
"""

import warp as wp

from ..arrays import ContactArrays, VertexArrays
from .boxes import ContactShape
from .detection import DEEP

wp.set_module_options({"enable_backward": False})

NO_BEVEL = -1e30  # of a deep contact: it holds wherever the point is behind the face


@wp.func
def count_entry(contacts: ContactArrays, i: int):
    if wp.atomic_add(contacts.offsets, i, 1) == 0:
        contacts.touched[wp.atomic_add(contacts.counts, 1, 1)] = i


@wp.kernel(grid_stride=False)
def list_kernel(
    shape: ContactShape,
    state: VertexArrays,
    found: wp.array(dtype=wp.vec4i),  # [S]
    counts: wp.array(dtype=int),  # [S]
    ends: wp.array(dtype=int),  # [S] inclusive sums of counts
    contacts: ContactArrays,  # in and out; offsets are counts of entries
):
    s = wp.tid()
    if s == counts.shape[0] - 1:
        contacts.counts[0] = ends[s]
    count = counts[s]
    first = ends[s] - count
    p = shape.ends[s][0]
    q = shape.ends[s][1]
    share = shape.shares[s]
    i = int(0)
    while i < count:
        k = first + i
        face = found[s][i]
        deep = face <= DEEP
        if deep:
            face = DEEP - face
        corners = shape.faces[face]
        a = state.vertices[corners[0]]
        e1 = state.vertices[corners[1]] - a
        e2 = state.vertices[corners[2]] - a
        r = state.vertices[p] - a
        if share > 0.0:
            r = (1.0 - share) * r + share * (state.vertices[q] - a)
        contacts.vertices[k, 0] = p
        contacts.vertices[k, 1] = q
        contacts.shares[k] = share
        count_entry(contacts, p)
        if share > 0.0:
            count_entry(contacts, q)
        for j in range(3):
            contacts.vertices[k, 2 + j] = corners[j]
            contacts.spans[k, j] = e1[j]
            contacts.spans[k, 3 + j] = e2[j]
            contacts.spans[k, 6 + j] = r[j]
            contacts.bevels[k, j] = wp.where(deep, NO_BEVEL, shape.bevels[face][j])
            contacts.bevels[k, 3 + j] = wp.where(deep, NO_BEVEL, shape.rims[face][j])
            contacts.bevels[k, 6 + j] = wp.where(deep, -NO_BEVEL, shape.tops[face][j])
            count_entry(contacts, corners[j])
        i += 1


@wp.kernel(grid_stride=False)
def enter_kernel(
    contacts: ContactArrays,
    entries: wp.array(dtype=int),  # [5 N] out
):
    """List each contact with its vertices; offsets are their ends and become their beginnings.

    Threads begin with the last contact: one after another, they leave the entries in order.
    """
    k = contacts.counts[0] - 1 - wp.tid()
    if k < 0:
        return
    for j in range(5):
        if j != 1 or contacts.shares[k] > 0.0:
            i = contacts.vertices[k, j]
            entries[wp.atomic_sub(contacts.offsets, i, 1) - 1] = 8 * k + j


@wp.kernel(grid_stride=False)
def sort_kernel(
    unsorted: wp.array(dtype=int),  # [5 N] entries in any order within each vertex's
    contacts: ContactArrays,  # entries: out
):
    """Sort each vertex's entries: each thread finds the place of one."""
    k = wp.tid() // 5
    j = wp.tid() % 5
    if k >= contacts.counts[0] or (j == 1 and not contacts.shares[k] > 0.0):
        return
    i = contacts.vertices[k, j]
    entry = 8 * k + j
    first = contacts.offsets[i]
    place = first
    for e in range(first, contacts.offsets[i + 1]):
        if unsorted[e] < entry:
            place += 1
    contacts.entries[place] = entry
