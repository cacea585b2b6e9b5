"""Preparing a model: all kernels are loaded, and the user is told what takes long."""

import os
import subprocess
import sys

import pytest
import warp as wp

from deformrf.viewer.loading import STAGES, Progress, kernel_modules, load_kernels, prepare


def prepared(ball, device):
    modules = kernel_modules(device)
    progress = Progress(len(modules))
    return *prepare(ball, "ball", device, modules, progress), progress


def test_each_device_has_its_own_kernels():
    modules = kernel_modules("cpu")
    for name in ("render.rays.marching", "render.modes", "field.encoding", "deform.tangles"):
        assert f"deformrf.core.{name}" in modules
    assert len(modules) == len(set(modules))
    for name in ("deform.frame.cuda", "field.networks.mma"):  # a CPU never launches them
        assert f"deformrf.core.{name}" not in modules


@pytest.mark.gpu
def test_a_model_is_prepared_on_a_gpu(ball):
    scene, _, progress = prepared(ball, "cuda:0")
    assert progress.fraction == 1.0
    scene.single_step()


def test_scene_and_renderer_are_of_the_model_and_every_stage_is_timed(ball):
    scene, renderer, progress = prepared(ball, "cpu")
    assert scene.field is renderer.field is ball
    assert len(progress.seconds) == len(STAGES)
    assert progress.fraction == 1.0


def test_no_other_module_is_needed_in_the_end(ball, monkeypatch):
    needed, load = [], wp.Module.load

    def noted(module, *arguments, **options):
        needed.append(module.name)
        return load(module, *arguments, **options)

    monkeypatch.setattr(wp.Module, "load", noted)
    prepared(ball, "cpu")
    needed = {name for name in needed if name.startswith("deformrf.")}
    assert needed == set(kernel_modules("cpu"))


def test_stages_are_named_and_add_up():
    progress = Progress(module_count=2)
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


SMALLEST = ["deformrf.core.render.subpixel"]  # three small kernels
LOAD = f"""
from deformrf.core.device import start_warp
start_warp()
import deformrf.core.render.subpixel
from deformrf.viewer.loading import Progress, load_kernels
progress = Progress(1)
load_kernels({SMALLEST}, "cpu", progress)
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


def test_an_error_of_a_kernel_is_not_lost(monkeypatch):
    def broken(name, device):
        raise RuntimeError("no compiler")

    monkeypatch.setattr(wp, "load_module", broken)
    with pytest.raises(RuntimeError, match="no compiler"):
        load_kernels(kernel_modules("cpu"), "cpu", Progress(1))


@pytest.mark.gl
def test_the_window_shows_the_stages_and_a_bar(window, monkeypatch):
    from imgui_bundle import imgui

    from deformrf.viewer.gui import Gui
    from deformrf.viewer.panels import loading_window

    gui = Gui(window[0])
    lines, notes, bars = [], [], []
    monkeypatch.setattr(imgui, "text", lines.append)
    monkeypatch.setattr(imgui, "text_disabled", notes.append)
    monkeypatch.setattr(imgui, "progress_bar", lambda fraction, size, text: bars.append(text))
    progress = Progress(module_count=1)
    for cached in (True, False):
        progress.begin_module("marching", cached)
        gui.begin()
        loading_window("preparing ball", progress)
        gui.end()
    progress.end_module("marching")
    progress.end_stage()
    gui.begin()
    loading_window("preparing ball", progress)
    gui.end()
    gui.close()
    assert lines[:2] == ["preparing ball", "loading kernels, 0 of 1 modules done, 0 s"]
    assert lines[3] == "compiling kernels, 0 of 1 modules done, 0 s"
    assert lines[5].startswith(STAGES[1])
    assert bars == ["0%", "0%", "25%"]
    assert notes[: len(STAGES)] == [*STAGES[1:], STAGES[1]]
    assert notes.count("kernels are compiled on the first start only") == 2
