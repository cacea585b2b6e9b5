"""Preparing a model: kernels are all compiled, and a window can say how far it is."""

import pytest
import warp as wp

from deformrf.viewer.loading import OTHERS, Progress, kernel_modules, prepare


def test_the_modules_are_those_of_renderer_and_solver():
    import deformrf.core.render.modes  # noqa: F401  the window imports it

    modules = kernel_modules("cpu")
    for name in ("render.rays.marching", "render.modes", "field.encoding", "deform.tangles"):
        assert f"deformrf.core.{name}" in modules
    assert "deformrf.core.deform.frame.cpu" in modules
    assert "deformrf.core.deform.frame.cuda" not in modules
    assert len(modules) == len(set(modules))
    assert all(name.startswith("deformrf.core.") for name in modules)


def test_each_device_has_its_own_frames():
    modules = kernel_modules("cuda:0")
    assert "deformrf.core.deform.frame.cuda" in modules
    assert "deformrf.core.deform.frame.cpu" not in modules


@pytest.mark.gpu
def test_a_model_is_prepared_on_a_gpu(ball):
    progress = Progress(kernel_modules("cuda:0"))
    scene, _ = prepare(ball, "ball", "cuda:0", progress)
    assert progress.fraction == 1.0
    scene.single_step()


def test_every_stage_is_counted(ball):
    progress = Progress(kernel_modules("cpu"))
    seen, done = [], progress.done

    def noted():
        seen.append((progress.fraction, progress.current[0]))
        done()

    progress.done = noted
    scene, renderer = prepare(ball, "ball", "cpu", progress)
    assert scene.field is renderer.field is ball
    assert [stage for _, stage in seen] == progress.stages
    assert seen[0][0] == 0.0
    assert progress.fraction == 1.0
    assert progress.stages[-len(OTHERS) :] == list(OTHERS)
    assert f"1 of {len(progress.modules)}" in progress.stages[0]


def test_no_other_module_is_needed_in_the_end(ball, monkeypatch):
    progress, needed = Progress(kernel_modules("cpu")), []
    load = wp.Module.load

    def noted(module, *arguments, **options):
        needed.append(module.name)
        return load(module, *arguments, **options)

    monkeypatch.setattr(wp.Module, "load", noted)
    prepare(ball, "ball", "cpu", progress)
    assert {name for name in needed if name.startswith("deformrf.")} == set(progress.modules)


@pytest.mark.gl
def test_the_window_shows_the_stages_and_a_bar(window, monkeypatch):
    from imgui_bundle import imgui

    from deformrf.viewer.gui import Gui
    from deformrf.viewer.panels.loading import loading_window

    gui = Gui(window[0])
    lines, bars = [], []
    monkeypatch.setattr(imgui, "text", lines.append)
    monkeypatch.setattr(imgui, "progress_bar", lambda fraction, size, text: bars.append(text))
    progress = Progress(["deformrf.core.render.rays.marching"])
    for _ in range(2):
        gui.begin()
        loading_window("preparing ball", progress)
        gui.end()
        progress.done()
    gui.close()
    assert lines[:2] == ["preparing ball", "compiling kernels 1 of 1: marching, 0 s"]
    assert lines[3].startswith(OTHERS[0])
    assert bars == ["0%", "25%"]
