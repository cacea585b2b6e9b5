"""The windows of the Record button: what film to make, and how far it is."""

from functools import partial

from imgui_bundle import imgui

from ..files import readable
from ..films import FORMATS, RATES, SAMPLE_COUNTS, SIZES
from .widgets import checkbox, combo, was_entered

FILM_WIDTH = 300.0
BLUR_TOOLTIP = """spreads the samples over half a frame's time;
it needs 4 samples or more, and 16 look smooth"""
SAMPLES_TOOLTIP = "rays a pixel: 16 make smooth edges, and take 16 times as long"


def film_window(takes):
    """Ask for size, rate, format and name of a film of the last take."""
    choices = takes.choices
    imgui.push_item_width(0.6 * FILM_WIDTH)
    imgui.text(f"a film of {takes.take.seconds:.1f} s, rendered in full")

    def change(name, convert=str):
        return lambda value: setattr(choices, name, convert(value))

    combo("size", choices.size, SIZES, change("size"))
    combo("frames a second", str(choices.fps), map(str, RATES), change("fps", int))
    counts = map(str, SAMPLE_COUNTS)
    combo("samples", str(choices.samples), counts, change("samples", int), SAMPLES_TOOLTIP)
    imgui.begin_disabled(choices.samples == 1)
    checkbox("motion blur", choices.blur, partial(setattr, choices, "blur"), BLUR_TOOLTIP)
    imgui.end_disabled()
    combo("format", choices.format, FORMATS, change("format"))
    imgui.begin_disabled(not choices.can_be_transparent)
    checkbox("transparent", choices.transparent, partial(setattr, choices, "transparent"))
    imgui.end_disabled()
    checkbox("vertices in the film", choices.handles, partial(setattr, choices, "handles"))
    if takes.problem and not imgui.is_any_item_active():
        imgui.set_keyboard_focus_here()  # for another name
    changed, name = imgui.input_text(
        "name", choices.name, imgui.InputTextFlags_.auto_select_all.value
    )
    if changed:
        choices.name = name
    imgui.text_disabled(readable(choices.path) if choices.name else "a film needs a name")
    if takes.problem:
        imgui.push_text_wrap_pos(FILM_WIDTH)
        imgui.text_wrapped(readable(takes.problem))
        imgui.pop_text_wrap_pos()
    imgui.begin_disabled(not choices.name)
    if (imgui.button("Render") or was_entered()) and choices.name:
        takes.start_film()
    imgui.end_disabled()
    imgui.same_line()
    if imgui.button("Not now"):
        takes.asking = False
    imgui.pop_item_width()


def progress_window(takes):
    """How far a film is, with a button that ends it."""
    job = takes.job
    imgui.text("rendering the film")
    left = job.seconds_left
    share = job.frame / max(job.count, 1)
    text = f"{job.frame} of {job.count}" if job.count else "starting"
    imgui.progress_bar(share, (FILM_WIDTH, 0.0), text)
    if left is not None:
        imgui.text_disabled(f"{left / 60.0:.0f} min left" if left > 90.0 else f"{left:.0f} s left")
        imgui.same_line()
    if imgui.small_button("End it here"):
        job.cancel()
