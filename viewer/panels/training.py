"""How a training run goes: its step, its curve, and buttons to let it wait or stop it."""

import numpy as np
from imgui_bundle import imgui, implot

WIDTH, HEIGHT = 320.0, 130.0
PLAIN = (
    implot.Flags_.no_legend.value
    | implot.Flags_.no_mouse_text.value
    | implot.Flags_.no_inputs.value
    | implot.Flags_.no_menus.value
)
FITTED = implot.AxisFlags_.auto_fit.value


def training_panel(live, scene):
    last = live.last
    if last is None:
        imgui.text(*training_lines(live))
        return
    if scene is None and not live.ended:
        imgui.text(f"the first picture: {live.preparing.stage}")
    for line in training_lines(live):
        imgui.text(line)
    imgui.progress_bar(last.step / last.step_count, (WIDTH, 0.0))
    _curve(last.history)
    if not live.ended:
        _buttons(live)


def training_lines(live) -> list[str]:
    """The run so far, in words."""
    last = live.last
    if last is None:
        return ["training begins"]
    where = f"stage {last.stage} of 2, step {last.step} of {last.step_count}"
    if live.ended:
        where = f"the run is over after {clock(last.seconds)}"
    elif live.stopping:
        where = "stopping; the model is written"
    elif live.trained:
        where = "trained; the model is written and scored"
    elif live.waiting:
        where += ", waiting"
    found = [where]
    if last.history:
        rate = f"{last.samples_per_second / 1e6:.2f} M samples/s"
        found.append(f"{last.history[-1]['psnr']:.2f} dB on its training rays, {rate}")
    if live.steps_per_second > 0.0 and not (live.ended or live.trained or live.stopping):
        left = (last.step_count - last.step) / live.steps_per_second
        found.append(f"{clock(last.seconds)} so far, {clock(left)} left in this stage")
    return found


def clock(seconds: float) -> str:
    """Minutes and seconds, as in 3:07."""
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def curve(history) -> tuple[np.ndarray, np.ndarray]:
    """Steps since the run's beginning, and PSNR [dB], of the rows of a history.  [N], [N]"""
    first = max((row["step"] for row in history if row["stage"] == 1), default=0)
    steps = [row["step"] + first * (row["stage"] == 2) for row in history]
    return np.array(steps, float), np.array([row["psnr"] for row in history], float)


def _curve(history):
    if len(history) < 2:
        return
    if implot.get_current_context() is None:
        implot.create_context()
    if implot.begin_plot("##curve", (WIDTH, HEIGHT), PLAIN):
        implot.setup_axes("steps", "dB", FITTED, FITTED)
        implot.plot_line("##psnr", *curve(history))
        implot.end_plot()


def _buttons(live):
    imgui.begin_disabled(live.stopping or live.trained)
    if imgui.button("Go on" if live.paused else "Pause"):
        live.paused = not live.paused
    imgui.set_item_tooltip("the run waits after its next few steps; the object can be bent")
    imgui.same_line()
    if imgui.button("Stop and save"):
        live.stop()
    imgui.set_item_tooltip("as Ctrl-C does: writes the model as it is; --resume continues the run")
    imgui.end_disabled()
