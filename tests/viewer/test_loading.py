"""Preparing a model: all kernels are loaded, and the user is told what takes long."""

import os
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from deformrf.core.deform import TIME_STEP
from deformrf.viewer import loading
from deformrf.viewer.loading import STAGES, Progress, kernel_modules, load_kernels, prepare
from deformrf.wings import rig


def prepared(ball, device):
    progress = Progress(device)
    return *prepare(ball, "ball", device, progress), progress


def test_each_device_has_its_own_kernels():
    modules = kernel_modules("cpu")
    for name in ("render.cpu_tiles", "render.modes", "render.rounds.cpu", "deform.tangles"):
        assert f"deformrf.core.{name}" in modules
    assert len(modules) == len(set(modules))
    for name in ("deform.frame.cuda", "field.networks.mma"):  # a CPU never launches them
        assert f"deformrf.core.{name}" not in modules


@pytest.mark.gpu
def test_a_model_is_prepared_on_a_gpu(ball):
    scene, _, progress = prepared(ball, "cuda:0")
    assert progress.fraction == 1.0
    scene.clock.single_step()


def test_scene_and_renderer_are_of_the_model_and_every_stage_is_timed(ball):
    scene, renderer, progress = prepared(ball, "cpu")
    assert scene.field is renderer.field is ball
    assert len(progress.seconds) == len(STAGES)
    assert progress.fraction == 1.0


@pytest.fixture
def needed(monkeypatch):
    """The names of our modules that are loaded, or used, from now on."""
    names, load = set(), wp.Module.load

    def noted(module, *arguments, **options):
        if module.name.startswith("deformrf."):
            names.add(module.name)
        return load(module, *arguments, **options)

    monkeypatch.setattr(wp.Module, "load", noted)
    return names


def test_no_other_module_is_needed_in_the_end(ball, needed):
    prepared(ball, "cpu")
    assert needed == set(kernel_modules("cpu"))


def test_no_other_module_is_needed_when_bones_move(ball, needed):
    skeleton = rig.make_skeleton(["bone"], [-1], [(0.5, 0.5, 0.1)], [(0.5, 0.5, 0.9)])
    weights = np.ones((ball.mesh.vertex_count, 1), np.float32)
    arrays = rig.arrays_of(rig.Rig(skeleton, weights))
    scene, _, _ = prepared(replace(ball, rig_arrays=arrays), "cpu")
    before = set(needed)
    for softness in (0.0, 0.5):
        scene.posing.set_softness(softness)
        scene.posing.hold_bone(0)
        scene.clock.advance(TIME_STEP)
    assert needed == before


@pytest.fixture
def two_modules(monkeypatch):
    """A Progress that waits for the modules a and b."""
    monkeypatch.setattr(loading, "kernel_modules", lambda device: ["a", "b"])
    return Progress("cpu")


def test_stages_are_named_and_add_up(two_modules):
    progress = two_modules
    progress.begin_module("a", cached=True)
    assert progress.stage == "loading kernels, 0 of 2 modules done"
    progress.end_module("a")
    progress.begin_module("b", cached=False)
    assert progress.stage == "compiling kernels, 1 of 2 modules done"
    assert progress.fraction == 1 / 5
    progress.end_module("b")
    assert progress.compiled and not progress.compiling
    for name, fraction in zip((*STAGES[1:], STAGES[-1]), (2 / 5, 3 / 5, 4 / 5, 1.0), strict=True):
        progress.end_stage()
        assert (progress.stage, progress.fraction) == (name, pytest.approx(fraction))


LOAD = """
from deformrf.core.base.device import start_warp
start_warp()
import deformrf.core.render.subpixel  # two small kernels
from deformrf.viewer import loading
loading.kernel_modules = lambda device: ["deformrf.core.render.subpixel"]
progress = loading.Progress("cpu")
loading.load_kernels("cpu", progress)
print(progress.compiled)
"""


def test_a_kernel_is_compiled_where_the_cache_is_empty_and_only_there(tmp_path):
    """In a process of its own: what this one has loaded is not looked up in the cache."""
    said = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", LOAD],
            env={**os.environ, "WARP_CACHE_PATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        said.append(done.stdout.split())
    assert said == [["True"], ["False"]]


@pytest.mark.parametrize("removed", ["get_module_identifier", "options"])
def test_with_another_version_of_warp_every_module_counts_as_cached(monkeypatch, removed):
    """Warp's internals, which tell whether a module is, may change."""
    module = wp.get_module(kernel_modules("cpu")[0])
    changed = SimpleNamespace(
        get_module_identifier=module.get_module_identifier, options=module.options
    )
    delattr(changed, removed)
    monkeypatch.setattr(wp, "get_module", lambda name: changed)
    monkeypatch.setattr(wp, "get_device", lambda name: SimpleNamespace(is_cpu=removed != "options"))
    assert loading.is_cached(module.name, "cpu")


def test_an_error_of_a_kernel_is_not_lost(monkeypatch, two_modules):
    def broken(name, device):
        raise RuntimeError("no compiler")

    monkeypatch.setattr(wp, "load_module", broken)
    monkeypatch.setattr(loading, "is_cached", lambda name, device: False)
    with pytest.raises(RuntimeError, match="no compiler"):
        load_kernels("cpu", two_modules)


@pytest.mark.gl
def test_the_window_shows_the_stages_and_a_bar(window, monkeypatch, two_modules):
    from imgui_bundle import imgui

    from deformrf.viewer.gui import Gui
    from deformrf.viewer.panels import Panels

    gui = Gui(window[0])
    lines, notes, bars = [], [], []
    begun = two_modules._since
    monkeypatch.setattr(loading, "time", SimpleNamespace(perf_counter=lambda: begun))
    monkeypatch.setattr(imgui, "text", lines.append)
    monkeypatch.setattr(imgui, "text_disabled", notes.append)
    monkeypatch.setattr(imgui, "progress_bar", lambda fraction, size, text: bars.append(text))

    def shown():
        gui.begin()
        Panels(SimpleNamespace(gui=gui)).loading_window("preparing ball", two_modules)
        gui.end()
        return lines[-1]

    two_modules.begin_module("a", cached=True)
    assert shown() == "loading kernels, 0 of 2 modules done, 0 s"
    two_modules.end_module("a")
    two_modules.begin_module("b", cached=False)
    assert shown() == "compiling kernels, 1 of 2 modules done, 0 s"
    two_modules.end_module("b")
    two_modules.end_stage()
    assert shown() == f"{STAGES[1]}, 0 s"
    gui.close()
    assert lines[0] == "preparing ball"
    assert bars == ["0%", "20%", "40%"]
    assert notes[: len(STAGES)] == [*STAGES[1:], STAGES[1]]
    assert notes.count("kernels are compiled on the first start only") == 2
