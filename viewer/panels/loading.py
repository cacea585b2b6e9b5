"""The window while a model is being prepared: what is done, what is going on."""

from imgui_bundle import imgui

from .layout import FLOATING

BAR_WIDTH = 360.0


def loading_window(title: str, progress) -> None:
    """The stages of a loading.Progress, with a bar."""
    size = imgui.get_io().display_size
    imgui.set_next_window_pos((0.5 * size.x, 0.5 * size.y), pivot=(0.5, 0.5))
    imgui.begin("loading", flags=FLOATING | imgui.WindowFlags_.no_inputs.value)
    imgui.text(title)
    done = list(progress.seconds)
    for stage, seconds in zip(progress.stages, done, strict=False):
        imgui.text_disabled(f"{stage}, {seconds:.1f} s")
    stage, seconds = progress.current
    imgui.text(f"{stage}, {seconds:.0f} s")
    for stage in progress.stages[len(done) + 1 :]:
        imgui.text_disabled(stage)
    imgui.progress_bar(progress.fraction, (BAR_WIDTH, 0.0), f"{progress.fraction:.0%}")
    imgui.text_disabled("kernels are compiled on the first start only")
    imgui.end()
