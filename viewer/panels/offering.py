"""The windows about training that the viewer begins: the offer, and how far it is."""

import time

from imgui_bundle import imgui

WIDTH = 300.0


def offer_panel(offer, begin, width) -> bool:
    """Ask whether photographs shall be trained; whether the user has answered."""
    imgui.text(offer.title)
    imgui.push_text_wrap_pos(width)
    for line in offer.lines():
        imgui.text_wrapped(line)
    imgui.pop_text_wrap_pos()
    if imgui.button("Train"):
        begin()
        return True
    imgui.same_line()
    return imgui.button("Not now")


def job_window(train_job) -> None:
    """How far training is, with a button that ends it and keeps the work."""
    job = train_job
    minutes, seconds = divmod(int(time.monotonic() - job.began), 60)
    imgui.text(f"training {job.offer.output.stem}: {minutes}:{seconds:02}")
    told = job.progress
    text = (
        "finding the cameras" if told is None else "stage {stage}, {step} of {steps}".format(**told)
    )
    imgui.progress_bar(job.share, (WIDTH, 0.0), text)
    imgui.push_text_wrap_pos(WIDTH)
    imgui.text_disabled(job.line)
    imgui.pop_text_wrap_pos()
    imgui.begin_disabled(job.stopping)
    if imgui.small_button("Stop and keep the work"):
        job.stop()
    imgui.end_disabled()
