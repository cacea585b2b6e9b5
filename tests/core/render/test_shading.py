"""Density and color of samples where only torch could evaluate the networks of a GPU."""

import sys

import numpy as np
import pytest
import torch
from fold_poses import folded, from_inside

from deformrf.core.render import Renderer, RenderOptions


@pytest.mark.parametrize("torch_is", ["missing", "a CPU build"])
@pytest.mark.parametrize("deferred", [False, True])
def test_the_host_shades_for_a_gpu_that_torch_does_not_serve(
    make_ball_field, device, monkeypatch, torch_is, deferred
):
    """In float32, on any GPU; a shading on the CPU that lacks its native code stands for one."""
    renderer = Renderer(make_ball_field(3, deferred=deferred), device)
    vertices = folded(renderer.field)
    renderer.set_vertices(vertices)
    renderer.merger._windows = None  # the merger asks for the values of samples
    options = RenderOptions(conformance=True, path="merge")
    expected = renderer.render(from_inside(vertices), options).color_array()
    if torch_is == "missing":
        monkeypatch.setitem(sys.modules, "torch", None)
    else:
        monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    renderer.shading.on_cpu = None
    vars(renderer.shading).pop("_host", None)
    found = renderer.render(from_inside(vertices), options).color_array()
    assert renderer.shading._host.device.is_cpu
    np.testing.assert_allclose(found.astype(int), expected, atol=1)
    assert expected[..., 3].any()
