"""The task *Film*, and its windows: what film to make, how far it is, its frame over the view."""

from imgui_bundle import imgui, imgui_ctx

from ..files import readable
from ..films import FORMATS, FREE, KINDS, RATES, SAMPLE_COUNTS, SIZES, TURN_SECONDS
from . import widgets as w

FILM_WIDTH = 340.0
BUTTONS = 150.0  # points that the window takes besides what is chosen
BLUR_TOOLTIP = """spreads the samples over half a frame's time;
it needs 4 samples or more, and 16 look smooth"""
SAMPLES_TOOLTIP = "rays a pixel: 16 make smooth edges, and take 16 times as long"
FORMS = {
    **dict.fromkeys(("1280x720", "1920x1080", "3840x2160"), ", landscape 16:9"),
    **{"1080x1080": ", square 1:1", "1080x1920": ", portrait 9:16"},
}
FOLDER_HINT = "the current folder"
STEPS = """Make a film: in full quality, of the timeline, of a turn, or of what you did.
Record what I do: begin, and stop later; a film can show just that.
Record the screen: at once, as coarse as the view."""
IN_PICTURES = "toggle_handles_in_clips", "toggle_panel_in_screenshots"  # boxes
RECORDING_RED = (0.95, 0.25, 0.20, 1.0)


def filming_panel(recorder, actions):
    w.buttons(actions, "save_film", "record", "record_screen", "screenshot")
    imgui.text_wrapped(STEPS)
    if video := recorder.video:
        told = f"{video.repeated_count} repeated, {video.dropped_count} left out"
        imgui.text(f"{video.frame_count} frames, {told}")
    for name in ("frame_guide", "toggle_transparent", *IN_PICTURES):
        w.buttons(actions, name)


def recording_line(takes, recorder) -> str:
    """What is being recorded, and how long; empty if nothing."""
    lines = [f"recording, {takes.seconds:.1f} s"] if takes.recording else []
    if recorder.video:
        lines.append(f"clip of the screen, {recorder.video.seconds:.1f} s")
    return "; ".join(lines)


def film_window(takes) -> None:
    choices = takes.choices
    imgui.text("What should the film show?")
    height = imgui.get_io().display_size.y - BUTTONS
    imgui.set_next_window_size_constraints((FILM_WIDTH, 0.0), (FILM_WIDTH, max(height, 60.0)))
    flags = imgui.ChildFlags_.auto_resize_y.value
    with imgui_ctx.begin_child("choices", (FILM_WIDTH, 0.0), flags):
        _kinds(takes)
        imgui.separator()
        _picture(choices, takes.size)
        _file(choices, takes.problem)
    why_not = takes.why_not(choices.what) if choices.name else "a film needs a name"
    seconds = takes.film_seconds(choices.what)
    known = f"{choices.path}\n{seconds:.1f} s long; rendering: {takes.estimator.line}"
    with imgui_ctx.push_text_wrap_pos(FILM_WIDTH):
        for line in filter(None, (takes.problem, why_not or known)):
            imgui.text_wrapped(readable(line))
    imgui.begin_disabled(bool(why_not))
    answer = w.answers("Render", enter="Render")
    imgui.end_disabled()
    imgui.same_line()
    if answer and not why_not:
        takes.start_film()
    elif imgui.button("Cancel"):
        takes.asking = False


def _kinds(takes):
    """What is filmed; what can't be says why."""
    choices = takes.choices
    for kind, title in KINDS.items():
        why_not = takes.why_not(kind)
        imgui.begin_disabled(bool(why_not))
        if w.radio(f"{title}: {why_not}" if why_not else title, choices.what == kind):
            choices.what = kind
        imgui.end_disabled()
    if choices.what == "turntable":
        w.slider("seconds a turn", *w.of(choices, "turn_seconds"), TURN_SECONDS, "%.1f")


def _picture(choices, window_size):
    """Its size, rate and looks."""
    sizes = {size.replace("x", " x ") + FORMS.get(size, ""): size for size in SIZES}
    w.combo("size", *w.of(choices, "size"), sizes)
    if choices.size == FREE:
        w.sides("width, height", choices, "free_size")
    if choices.size not in FORMS:  # which say so themselves
        imgui.text_disabled(choices.size_line(window_size))
    w.combo("frames a second", *w.of(choices, "fps"), RATES)
    w.combo("samples", *w.of(choices, "samples"), SAMPLE_COUNTS, SAMPLES_TOOLTIP)
    w.combo("format", *w.of(choices, "format"), list(FORMATS))
    imgui.begin_disabled(choices.samples == 1)
    w.checkbox("motion blur", *w.of(choices, "blur"), BLUR_TOOLTIP)
    imgui.end_disabled()
    imgui.same_line()
    imgui.begin_disabled(not choices.can_be_transparent)
    w.checkbox("transparent", *w.of(choices, "transparent"))
    imgui.end_disabled()
    w.checkbox("red points and bones in this film", *w.of(choices, "handles"))


def _file(choices, problem):
    """Its name and folder; after a problem, what is typed is another name."""
    if problem and not imgui.is_any_item_active():
        imgui.set_keyboard_focus_here()
    flags = imgui.InputTextFlags_.auto_select_all.value
    choices.name = imgui.input_text(w.named("name"), choices.name, flags)[1]
    choices.folder = w.text_field(w.named("folder"), choices.folder, FOLDER_HINT)


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
