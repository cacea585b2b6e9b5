"""Recorded launches do the same as others, each time."""

import gc
import weakref

import numpy as np
import warp as wp
from fold_poses import folded, from_inside
from slot_rendering import in_slots

from deformrf.core.base.recorded import Recorded
from deformrf.core.render import Renderer


@wp.kernel
def double_kernel(values: wp.array(dtype=float)):
    values[wp.tid()] *= 2.0


def test_each_call_launches_with_what_the_arrays_hold_then(device):
    values = wp.array(np.arange(5.0, dtype=np.float32), device=device)
    calls = []

    def launch():
        calls.append(None)
        wp.launch(double_kernel, len(values), [values], device=device)
        wp.launch(double_kernel, len(values), [values], device=device)

    recorded = Recorded(device)
    for _ in range(4):
        recorded(launch)
    np.testing.assert_array_equal(values.numpy(), 256.0 * np.arange(5))
    values.assign(np.ones(5, np.float32))
    recorded(launch)
    np.testing.assert_array_equal(values.numpy(), np.full(5, 4.0))
    assert len(calls) == (2 if wp.get_device(device).is_cuda else 5)


def test_memory_is_freed_with_what_records(make_ball_field, device):
    """At once: the next image, or the next model, needs it."""
    field = make_ball_field(2)
    vertices = folded(field)
    renderer = in_slots(Renderer(field, device))
    gc.collect()
    gc.disable()
    try:
        for share in (1.0, 0.9, 0.8):
            renderer.set_vertices(vertices * np.float32(share))
            renderer.render(from_inside(vertices, 8))
        parts = renderer.pose, renderer.overlap, renderer._wavefront, renderer._windows
        alive = [weakref.ref(part) for part in parts]
        del renderer, parts
        assert [part() for part in alive] == [None] * 4
    finally:
        gc.enable()
