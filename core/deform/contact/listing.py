"""Lists what was found: contacts in the order of samples, and for each vertex its contacts.

The order doesn't depend on that of threads, so a frame gives the same bits again.

Shapes: V vertices, S samples, N contacts.
"""

import warp as wp

from ..arrays import ContactArrays, VertexArrays
from .boxes import ContactShape
from .detection import DEEP

wp.set_module_options({"enable_backward": False})

NO_BEVEL = -1e30  # of a deep contact: it holds wherever the point is behind the face


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
        contacts.count[0] = ends[s]
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
        wp.atomic_add(contacts.offsets, p, 1)
        if share > 0.0:
            wp.atomic_add(contacts.offsets, q, 1)
        for j in range(3):
            contacts.vertices[k, 2 + j] = corners[j]
            contacts.spans[k, j] = e1[j]
            contacts.spans[k, 3 + j] = e2[j]
            contacts.spans[k, 6 + j] = r[j]
            contacts.bevels[k, j] = wp.where(deep, NO_BEVEL, shape.bevels[face][j])
            contacts.bevels[k, 3 + j] = wp.where(deep, NO_BEVEL, shape.rims[face][j])
            contacts.bevels[k, 6 + j] = wp.where(deep, -NO_BEVEL, shape.tops[face][j])
            wp.atomic_add(contacts.offsets, corners[j], 1)
        i += 1


@wp.kernel(grid_stride=False)
def enter_kernel(contacts: ContactArrays):
    """List each contact with its vertices; offsets are their ends and become their beginnings."""
    k = wp.tid()
    if k >= contacts.count[0]:
        return
    for j in range(5):
        if j != 1 or contacts.shares[k] > 0.0:
            i = contacts.vertices[k, j]
            contacts.entries[wp.atomic_sub(contacts.offsets, i, 1) - 1] = 8 * k + j


@wp.kernel(grid_stride=False)
def sort_kernel(contacts: ContactArrays):
    """Sort each vertex's entries, which threads have listed in any order."""
    i = wp.tid()
    first = contacts.offsets[i]
    for k in range(first + 1, contacts.offsets[i + 1]):
        entry = contacts.entries[k]
        place = k
        while place > first and contacts.entries[wp.max(place - 1, 0)] > entry:
            contacts.entries[place] = contacts.entries[place - 1]
            place -= 1
        contacts.entries[place] = entry
