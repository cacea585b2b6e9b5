"""A viewer can compile every kernel of rendering in advance, and compiles no others."""

import importlib

import numpy as np
import pytest
import warp as wp

from deformrf.core import deform
from deformrf.core.base import shipped_kernels
from deformrf.core.render import (
    MODES,
    Renderer,
    RenderOptions,
    RunningMean,
    Upsampling,
    from_field_of_view,
    kernel_modules,
    look_at,
    render_mode,
)
from deformrf.core.render import deferred as deferred_module
from deformrf.core.render.rounds import ray_color, slot_densities, tracing
from deformrf.wings.rig import Skinner

TET = np.array([[-0.3, -0.3, 0.2], [0.3, -0.3, 0.2], [0.0, 0.4, 0.2], [0, 0, 0.7]])


@pytest.mark.parametrize("deferred", [False, True])
def test_the_modules_are_those_that_rendering_loads(make_ball_field, device, monkeypatch, deferred):
    loaded, load = set(), wp.Module.load

    def noted(module, *arguments, **options):
        loaded.add(module.name)
        return load(module, *arguments, **options)

    monkeypatch.setattr(wp.Module, "load", noted)
    field = make_ball_field(0, deferred=deferred)
    renderer = Renderer(field, device)
    camera = from_field_of_view(look_at((1.4, 0.2, 1.0), (0.5, 0.5, 0.5)), 0.7, 16, 12)
    folded = field.mesh.rest_vertices.copy()
    folded[0] += 1.0  # turns tets inside out
    for vertices in (field.mesh.rest_vertices, folded):
        renderer.set_vertices(vertices)
        for mode in MODES:
            image = render_mode(renderer, camera, mode)
    mean = RunningMean(16, 12, device)
    mean.add(image)
    mean.color(1)
    if renderer.device.is_cpu:
        upsampling = Upsampling()
        image = upsampling.render(renderer, camera, (2, 2), RenderOptions(details=True), None)
        upsampling.upsampled(image, renderer, camera, (1.0, 1.0, 1.0), None, None)
    expected = set(kernel_modules(device))
    if not deferred:  # as models of this version are
        alone = ray_color, deferred_module, slot_densities, tracing
        expected -= {module.__name__ for module in alone}
    assert {name for name in loaded if name.startswith("deformrf.")} == expected


def test_the_tensor_cores_kernels_are_not_among_those_of_a_cpu():
    modules = kernel_modules("cpu")
    assert len(modules) == len(set(modules))
    assert not [name for name in modules if "mma" in name or "slots" in name or "tracing" in name]


def test_cudas_kernels_compile_without_a_gpu(tmp_path):
    """For an H100, to its own code, so that a machine without one tells of mistakes in them.

    PTX would not tell that a block needs more shared memory than there is.  What is shipped as it
    is now was compiled so.
    """
    wp.init()
    if not wp.get_cuda_supported_archs():
        pytest.skip("this Warp has no compiler for CUDA")
    shipped = shipped_kernels.read(shipped_kernels.archive_path(90))
    names = {*kernel_modules("cuda:0"), *deform.kernel_modules("cuda:0"), Skinner.__module__}
    for module in [wp.get_module(importlib.import_module(name).__name__) for name in names]:
        if module.get_module_hash().hex() not in shipped:
            wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=False)
            assert list(tmp_path.glob("*.cubin"))


def test_the_modules_of_dynamics_are_those_that_a_solver_loads(device, monkeypatch):
    """On CUDA without the module of the frame's main kernel, whose name is a hash."""
    load, loaded = wp.Module.load, set()

    def noted(module, *arguments, **options):
        loaded.add(module.name)
        return load(module, *arguments, **options)

    monkeypatch.setattr(wp.Module, "load", noted)
    tets = np.array([[0, 1, 2, 3], [4, 5, 6, 7]])
    two = np.concatenate([TET, TET + 2.0])
    bodies = deform.XpbdSolver(two, tets, deform.Material(), np.zeros(8, bool), device=device)
    bodies.grab([0])
    bodies.move([[0.1, 0.0, 0.0] + TET[0]])
    for _ in range(60):
        bodies.step(deform.TIME_STEP)
    bodies.release()
    for _ in range(60):  # tangles are counted
        bodies.step(deform.TIME_STEP)
    bodies.set_state(two - np.where(np.arange(8) < 4, 0.0, 2.0)[:, None])
    bodies.step(deform.TIME_STEP)  # they touch
    names = {name for name in loaded if name.startswith("deformrf.")}
    assert names == set(deform.kernel_modules(device))
