"""The windows about films: what film to make, how far it is, and its frame over the view."""

from functools import partial

from imgui_bundle import imgui

from ..files import readable
from ..films import FORMATS, FREE, KINDS, RATES, SAMPLE_COUNTS, SIZES, TURN_SECONDS
from .widgets import checkbox, combo, named, sides, slider, text_field, was_entered

FILM_WIDTH = 340.0
BUTTONS = 130.0  # points that the window takes besides what is chosen
COLOR = imgui.get_color_u32
SHADE, LINE = (0.0, 0.0, 0.0, 0.25), (1.0, 0.55, 0.1, 0.9)
BLUR_TOOLTIP = """spreads the samples over half a frame's time;
it needs 4 samples or more, and 16 look smooth"""
SAMPLES_TOOLTIP = "rays a pixel: 16 make smooth edges, and take 16 times as long"
FORMS = {
    **dict.fromkeys(("1280x720", "1920x1080", "3840x2160"), ", landscape 16:9"),
    **{"1080x1080": ", square 1:1", "1080x1920": ", portrait 9:16"},
}
FOLDER_HINT = "the current folder"


def film_window(takes) -> None:
    """Ask what film to make."""
    choices = takes.choices
    imgui.text("What should the film show?")
    height = imgui.get_io().display_size.y - BUTTONS
    imgui.set_next_window_size_constraints((FILM_WIDTH, 0.0), (FILM_WIDTH, max(height, 60.0)))
    if imgui.begin_child("choices", (FILM_WIDTH, 0.0), imgui.ChildFlags_.auto_resize_y.value):
        _kinds(takes)
        imgui.separator()
        _picture(choices, takes.size)
        _file(choices, takes.problem)
    imgui.end_child()
    is_good = choices.name and not takes.why_not(choices.what)
    seconds = takes.film_seconds(choices.what)
    known = f"a film of {seconds:.1f} s; {takes.estimator.line}" if is_good else ""
    imgui.push_text_wrap_pos(FILM_WIDTH)
    imgui.text_wrapped(readable(takes.problem or known))
    imgui.pop_text_wrap_pos()
    imgui.begin_disabled(not is_good)
    if (imgui.button("Render") or was_entered()) and is_good:
        takes.start_film()
    imgui.end_disabled()
    imgui.same_line()
    if imgui.button("Cancel"):
        takes.asking = False


def _kinds(takes):
    """What is filmed; what can't be says why."""
    choices = takes.choices
    for kind, title in KINDS.items():
        why_not = takes.why_not(kind)
        imgui.begin_disabled(bool(why_not))
        if imgui.radio_button(f"{title}: {why_not}" if why_not else title, choices.what == kind):
            choices.what = kind
        imgui.end_disabled()
    if choices.what == "turntable":
        change = partial(setattr, choices, "turn_seconds")
        slider("seconds a turn", choices.turn_seconds, TURN_SECONDS, "%.1f", change)


def _picture(choices, window_size):
    """Its size, rate and looks."""

    def change(name, convert=str):
        return lambda value: setattr(choices, name, convert(value))

    sizes = {f"{size}{FORMS.get(size, '')}": size for size in SIZES}
    shown = next(word for word, size in sizes.items() if size == choices.size)
    combo("size", shown, sizes, lambda word: setattr(choices, "size", sizes[word]))
    if choices.size == FREE:
        sides("width, height", choices.free_size, partial(setattr, choices, "free_size"))
    imgui.text_disabled(choices.size_line(window_size))
    combo("frames a second", str(choices.fps), map(str, RATES), change("fps", int))
    counts = map(str, SAMPLE_COUNTS)
    combo("samples", str(choices.samples), counts, change("samples", int), SAMPLES_TOOLTIP)
    combo("format", choices.format, FORMATS, change("format"))
    imgui.begin_disabled(choices.samples == 1)
    checkbox("motion blur", choices.blur, partial(setattr, choices, "blur"), BLUR_TOOLTIP)
    imgui.end_disabled()
    imgui.same_line()
    imgui.begin_disabled(not choices.can_be_transparent)
    checkbox("transparent", choices.transparent, partial(setattr, choices, "transparent"))
    imgui.end_disabled()
    checkbox("red points and bones in it", choices.handles, partial(setattr, choices, "handles"))


def _file(choices, problem):
    """Its name and folder; after a problem, what is typed is another name."""
    if problem and not imgui.is_any_item_active():
        imgui.set_keyboard_focus_here()
    flags = imgui.InputTextFlags_.auto_select_all.value
    choices.name = imgui.input_text(named("name"), choices.name, flags)[1]
    choices.folder = text_field(named("folder"), choices.folder, FOLDER_HINT)
    imgui.text_disabled(readable(choices.path) if choices.name else "a film needs a name")


def progress_window(takes) -> None:
    """How far a film is, with a button that ends it."""
    job = takes.job
    imgui.text("rendering the film")
    left = job.seconds_left
    share = job.frame / max(job.count, 1)
    text = f"{job.frame} of {job.count}" if job.count else "starting"
    imgui.progress_bar(share, (FILM_WIDTH, 0.0), text)
    if imgui.small_button("End it here"):  # before what comes later, which would move it
        job.stop()
    if left is not None:
        imgui.same_line()
        imgui.text_disabled(f"{left / 60.0:.0f} min left" if left > 90.0 else f"{left:.0f} s left")


def frame_overlay(frame) -> None:
    """Draw what a film shows of the view, and shade the rest.

    Args:
        frame: Left, top, width and height [points]: film_frame.
    """
    left, top, width, height = frame
    right, bottom, size = left + width, top + height, imgui.get_io().display_size
    lines = imgui.get_background_draw_list()
    for low, high in (
        ((0.0, 0.0), (size.x, top)),
        ((0.0, bottom), (size.x, size.y)),
        ((0.0, top), (left, bottom)),
        ((right, top), (size.x, bottom)),
    ):
        if low[0] < high[0] and low[1] < high[1]:
            lines.add_rect_filled(low, high, COLOR(SHADE))
    lines.add_rect((left, top), (right, bottom), COLOR(LINE))
