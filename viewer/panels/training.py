"""How a training run goes: its step, its curve, and buttons to let it wait or stop it."""

import time

import numpy as np
from imgui_bundle import imgui, implot

from ..files import readable

WIDTH, HEIGHT = 320.0, 130.0
PLAIN = (
    implot.Flags_.no_legend.value
    | implot.Flags_.no_mouse_text.value
    | implot.Flags_.no_inputs.value
    | implot.Flags_.no_menus.value
)
FITTED = implot.AxisFlags_.auto_fit.value


def training_panel(train_job, watcher, scene):
    job = train_job
    imgui.text(f"training {readable(job.output.stem)}: {clock(time.monotonic() - job.began)}")
    for line in training_lines(job):
        imgui.text(line)
    told = job.progress
    if told is not None:
        if scene is None and not job.ended:
            imgui.text(f"the first picture: {watcher.preparing.stage}")
        imgui.progress_bar(told["step"] / told["steps"], (WIDTH, 0.0))
        _curve(told["history"])
    if not job.ended:
        _buttons(job)


def training_lines(job) -> list[str]:
    """The run so far, in words."""
    told = job.progress
    if told is None:
        return [job.line]
    where = "stage {stage} of 2, step {step} of {steps}".format(**told)
    if job.ended:
        where = f"the run is over after {clock(told['seconds'])}"
    elif job.stopping:
        where = "stopping; the model is written"
    elif job.trained:
        where = "trained; the model is written and scored"
    elif job.paused:
        where += ", waiting"
    found = [where]
    if told["history"]:
        rate = f"{told['rate'] / 1e6:.2f} M samples/s"
        found.append(f"{told['history'][-1]['psnr']:.2f} dB on its training rays, {rate}")
    if job.steps_per_second > 0.0 and not (job.ended or job.trained or job.stopping):
        left = (told["steps"] - told["step"]) / job.steps_per_second
        found.append(f"{clock(told['seconds'])} so far, {clock(left)} left in this stage")
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


def _buttons(job):
    imgui.begin_disabled(job.stopping or job.trained)
    if imgui.button("Go on" if job.paused else "Pause"):
        job.pause(not job.paused)
    imgui.set_item_tooltip("the run waits after its next few steps; the object can be bent")
    imgui.same_line()
    if imgui.button("Stop and save"):
        job.stop()
    imgui.set_item_tooltip("as Ctrl-C does: writes the model as it is; --resume continues the run")
    imgui.end_disabled()
