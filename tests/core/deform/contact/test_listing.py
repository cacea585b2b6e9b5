"""The list of contacts and each vertex's entries in it."""

import numpy as np
import pytest
import warp as wp
from contact_scenes import pressed_balls

from deformrf.core.deform.contact import boxes, detection, listing
from deformrf.core.deform.contact.detection import DEEP
from deformrf.core.deform.contact.listing import NO_BEVEL


@pytest.fixture
def listed(device):
    """A Contact of two bodies that are pressed together, and their positions."""
    _, contact, state, _ = pressed_balls(device, 0.08, 1.0 / 60.0)
    return contact, state


def test_contacts_are_listed_in_the_order_of_samples(listed):
    contact, state = listed
    arrays, shape = contact.arrays, contact._shape
    count = arrays.counts.numpy()[0]
    faces, counts = contact._found.numpy(), contact._counts.numpy()
    assert count == counts.sum() > 100
    sample = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(count) - np.repeat(np.cumsum(counts) - counts, counts)
    face = faces[sample, place]
    deep = face <= DEEP
    assert deep.any() and not deep.all()
    face[deep] = DEEP - face[deep]
    ids = arrays.vertices.numpy()[:count]
    assert np.array_equal(ids[:, :2], shape.ends.numpy()[sample])
    assert np.array_equal(ids[:, 2:], shape.faces.numpy()[face])
    share = shape.shares.numpy()[sample]
    assert np.array_equal(arrays.shares.numpy()[:count], share)
    lists = [array.numpy()[face] for array in (shape.bevels, shape.rims, shape.tops)]
    bevels = np.concatenate(lists, axis=1)
    bevels[deep, :6], bevels[deep, 6:] = NO_BEVEL, -NO_BEVEL
    np.testing.assert_allclose(arrays.bevels.numpy()[:count], bevels)
    p, q, a, b, c = np.moveaxis(state[ids], 1, 0)
    point = p + share[:, None] * (q - p)
    spans = np.concatenate([b - a, c - a, point - a], axis=1)
    np.testing.assert_allclose(arrays.spans.numpy()[:count], spans, atol=2e-7)


def test_each_vertex_has_its_contacts_once_and_in_order(listed):
    arrays = listed[0].arrays
    count = arrays.counts.numpy()[0]
    ids, shares = arrays.vertices.numpy()[:count], arrays.shares.numpy()[:count]
    offsets, entries = arrays.offsets.numpy(), arrays.entries.numpy()
    for vertex in range(len(offsets) - 1):
        mine = entries[offsets[vertex] : offsets[vertex + 1]]
        contact, corner = np.nonzero(ids == vertex)
        takes_part = (corner != 1) | (shares[contact] > 0.0)
        assert np.array_equal(mine, (8 * contact + corner)[takes_part])


@pytest.mark.parametrize("module", [boxes, detection, listing])
def test_the_kernels_compile_for_a_gpu_without_one(module, tmp_path):
    assert wp.compile_aot_module(wp.get_module(module.__name__), arch=90, module_dir=tmp_path)
