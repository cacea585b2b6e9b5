"""Layout of the panels: one window with sections, the help overlay, the message line.

While a model is loaded, a window shows the progress.
"""

from operator import attrgetter

from imgui_bundle import imgui

from ..camera import Covered, film_frame
from ..files import readable
from ..input import inputs_of
from ..loading import STAGES
from ..questions import question
from .boxes import box_overlay, brush_overlay
from .camera import camera_panel
from .deform import deform_panel
from .dialogs import dialog_window
from .film import film_window, frame_overlay, progress_window
from .gizmo import gizmo_overlay
from .hand import hand_switch
from .history import history_panel
from .leaving import leaving_window
from .menu import menu_bar
from .offering import job_window
from .recovery import recovery_window
from .rig import rig_panel
from .selection import gesture_overlay
from .timeline import STRIP_HEIGHT, poses_panel, timeline_strip
from .training import training_lines, training_panel
from .view import RECORDING_RED, model_panel, record_panel, recording_line, time_panel, view_panel

BAR_WIDTH = 360.0
MARGIN = 12.0
HELP_FONT = 0.85  # of the panel's size
FIRST_LINE = "Drag the object, or a red point.  F1: keys"  # until that has been done once
HINT_COUNT = 5  # the first gestures of the mouse
FLOATING = (
    imgui.WindowFlags_.no_decoration.value
    | imgui.WindowFlags_.no_saved_settings.value
    | imgui.WindowFlags_.always_auto_resize.value
    | imgui.WindowFlags_.no_nav.value
)


def hints_panel(app):
    for entry in inputs_of(app.scene.settings.keys)[:HINT_COUNT]:
        imgui.text_disabled(f"{entry.label}: {entry.help}")


SECTIONS = (
    ("Model", model_panel, True),
    ("Bend", deform_panel, True),
    ("Rig", rig_panel, False),
    ("History", history_panel, False),
    ("View", view_panel, True),
    ("Camera", camera_panel, False),
    ("Poses", poses_panel, False),
    ("Record", record_panel, True),
    ("Time", time_panel, False),
    ("Mouse", hints_panel, True),
)


QUESTIONS = {
    "leaving": leaving_window,
    "recovery": recovery_window,
    "dialog": dialog_window,
    "film": lambda app: film_window(app.takes),
}


def draw_panels(app) -> None:
    """Everything that lies over the view."""
    for overlay in (box_overlay, gizmo_overlay, gesture_overlay, brush_overlay):
        overlay(app)
    if app.takes.shows_frame or app.takes.asking:
        size = app.window.width, app.window.height
        frame_overlay(film_frame(size, covered(app), app.takes.aspect))
    above = (STRIP_HEIGHT + MARGIN) * app.scene.settings.show_timeline
    if app.scene.settings.show_panel:
        _main_panel(app, top=menu_bar(app))
    if app.scene.settings.show_timeline:
        _strip(app)
    if not (app.scene.settings.show_panel or app.photographs):  # else the menu bar has it
        _hand(app)
    if app.scene.settings.show_help and not question(app):
        _floating("help", (0.5, 0.5))
        app.gui.guarded(help_overlay, app)
        app.gui.claim()
        imgui.end()
    if app.takes.job is not None:
        _floating("film's progress", (1.0, 1.0), above=above)
        app.gui.guarded(progress_window, app.takes)
        app.gui.claim()
        imgui.end()
    if app.train_job is not None:
        _floating("training's progress", (1.0, 0.0), top=imgui.get_frame_height())
        app.gui.guarded(job_window, app)
        app.gui.claim()
        imgui.end()
    if app.live is not None:
        training_window(app)
    if app.fly.on:
        over_message = above + 4.0 * MARGIN
        _floating("flying", (0.5, 1.0), imgui.WindowFlags_.no_inputs.value, over_message)
        imgui.text(app.fly.line)
        imgui.end()
    settings = app.scene.settings
    is_new = settings.tool == "grab" and not settings.has_dragged
    if is_new and not (settings.show_help or app.photographs):
        top = imgui.get_frame_height() * settings.show_panel
        _floating("first minute", (0.5, 0.0), imgui.WindowFlags_.no_inputs.value, top=top)
        imgui.text(FIRST_LINE)
        imgui.end()
    sign = recording_line(app)
    if sign and not app.scene.settings.show_panel:
        _floating("recording", (1.0, 0.0), imgui.WindowFlags_.no_inputs.value)
        imgui.text_colored(RECORDING_RED, sign)
        imgui.end()
    if app.recorder.message:
        _floating("message", (0.5, 1.0), imgui.WindowFlags_.no_inputs.value, above)
        imgui.text(app.recorder.message)
        imgui.end()
    _question(app)


def _question(app):
    """The window in the middle that asks something: one after another."""
    name, size = question(app), imgui.get_io().display_size
    if name:
        imgui.set_next_window_pos((0.5 * size.x, 0.5 * size.y), pivot=(0.5, 0.5))
    with app.gui.dialog(name, FLOATING) as shown:
        if shown:
            app.gui.guarded(QUESTIONS[name], app)


def covered(app) -> Covered:
    """What menus, open panel and timeline cover of the window."""
    settings = app.scene.settings
    bottom = (STRIP_HEIGHT + MARGIN) * settings.show_timeline
    if not settings.show_panel:
        return Covered(bottom=bottom)
    side = settings.panel_width + MARGIN if app.gui.panel_open else 0.0
    left, right = (side, 0.0) if settings.panel_side == "left" else (0.0, side)
    return Covered(left, imgui.get_frame_height(), right, bottom)


def _main_panel(app, top):
    size, settings = imgui.get_io().display_size, app.scene.settings
    below = (STRIP_HEIGHT + MARGIN) * (settings.show_timeline and not _beside(app))
    width, height = settings.panel_width, max(size.y - top - below - 2.0 * MARGIN, 100.0)
    x = MARGIN if settings.panel_side == "left" else size.x - MARGIN - width
    imgui.set_next_window_pos((x, top + MARGIN))
    imgui.set_next_window_size_constraints((width, 0.0), (width, height))
    flags = imgui.WindowFlags_.always_auto_resize.value | imgui.WindowFlags_.no_move.value
    app.gui.panel_open, _ = imgui.begin("deformrf", flags=flags)
    imgui.push_item_width(0.52 * width)
    for title, panel, is_open in SECTIONS:
        is_open = is_open or (title == "Rig" and app.scene.rigging.skeleton is not None)
        flags = imgui.TreeNodeFlags_.default_open.value if is_open else 0
        if imgui.collapsing_header(title, flags):
            imgui.push_id(title)  # a button may be called like a header, as Record is
            app.gui.guarded(panel, app)
            imgui.pop_id()
    imgui.pop_item_width()
    app.gui.claim()
    imgui.end()


def _hand(app):
    """The switch between Physics and Pose, in the upper left corner."""
    _floating("hand", (0.0, 0.0), top=MARGIN)
    app.gui.guarded(hand_switch, app)
    app.gui.claim()
    imgui.end()


def _beside(app):
    """Whether the timeline is beside the panel: there is space."""
    settings = app.scene.settings
    return settings.show_panel and imgui.get_io().display_size.x > 3.0 * settings.panel_width


def _strip(app):
    """The timeline along the lower edge, beside the panel or below it."""
    size, settings = imgui.get_io().display_size, app.scene.settings
    left = right = MARGIN
    if _beside(app):
        left += (settings.panel_width + MARGIN) * (settings.panel_side == "left")
        right += (settings.panel_width + MARGIN) * (settings.panel_side == "right")
    imgui.set_next_window_pos((left, size.y - MARGIN), pivot=(0.0, 1.0))
    imgui.set_next_window_size((max(size.x - left - right, 100.0), STRIP_HEIGHT))
    imgui.begin("timeline", flags=FLOATING & ~imgui.WindowFlags_.always_auto_resize.value)
    app.gui.guarded(timeline_strip, app)
    app.gui.claim()
    imgui.end()


def _floating(name, place, flags=0, above=0.0, top=0.0):
    """Begin a window without decoration: centered at (0.5, 0.5), at the bottom (0.5, 1) ...

    Args:
        above: Height of what is below it.
        top: Height of what is over it.
    """
    size = imgui.get_io().display_size
    x, y = place[0] * size.x, place[1] * (size.y - above)
    inwards = {0.0: MARGIN, 0.5: 0.0, 1.0: -MARGIN}
    imgui.set_next_window_pos((x + inwards[place[0]], y + top + inwards[place[1]]), pivot=place)
    told = flags & imgui.WindowFlags_.no_inputs.value
    if told:  # keys stay with the window that has them
        flags |= imgui.WindowFlags_.no_focus_on_appearing.value
    imgui.begin(name, flags=FLOATING | flags)
    if told:  # though a click has brought that one to the front
        imgui.internal.bring_window_to_display_front(imgui.internal.get_current_window())


def help_overlay(app):
    """The table of inputs, in as many columns as the window's height asks for.

    The letters are smaller where the columns would be wider than the window.
    """
    size, style = imgui.get_io().display_size, imgui.get_style()
    imgui.push_font(None, HELP_FONT * style.font_size_base)
    entries = list(filter(attrgetter("label"), inputs_of(app.scene.settings.keys)))
    row_height = imgui.get_text_line_height() + 2.0 * style.cell_padding.y
    fitting = max(int((size.y - 4.0 * MARGIN) / row_height), 1)
    columns = -(-len(entries) // fitting)
    rows = -(-len(entries) // columns)
    width = sum(
        max(imgui.calc_text_size(getattr(entry, name)).x for entry in entries[first : first + rows])
        + 2.0 * style.cell_padding.x
        for first in range(0, len(entries), rows)
        for name in ("label", "help")
    )
    smaller = min((size.x - 4.0 * MARGIN) / width, 1.0)
    imgui.pop_font()
    imgui.push_font(None, smaller * HELP_FONT * style.font_size_base)
    if imgui.begin_table("inputs", 2 * columns, imgui.TableFlags_.sizing_fixed_fit.value):
        for row in range(rows):
            imgui.table_next_row()
            for entry in entries[row::rows]:
                imgui.table_next_column()
                imgui.text(entry.label)
                imgui.table_next_column()
                imgui.text_disabled(entry.help)
        imgui.end_table()
    imgui.pop_font()


def playing_window(tick: int, patience) -> None:
    """How far a session has been played, and whether to go on if that takes long."""
    ticks = max(patience.total, 1)
    _floating("loading", (0.5, 0.5), imgui.WindowFlags_.no_inputs.value)
    imgui.text(f"playing the session, {tick // 60} of {ticks // 60} s")
    imgui.progress_bar(tick / ticks, (BAR_WIDTH, 0.0), patience.line(tick))
    asks = patience.asks(tick)
    imgui.text("This takes long. Enter: go on; Esc: stop" if asks else "Esc: stop")
    imgui.end()


def training_window(app) -> None:
    """How a training run goes, beside the panel; a line if the panels are hidden."""
    if app.scene is not None and not app.scene.settings.show_panel:
        _floating("training", (0.5, 0.0), imgui.WindowFlags_.no_inputs.value)
        imgui.text(training_lines(app.live)[0])
        imgui.end()
        return
    right = app.scene is None or app.scene.settings.panel_side == "left"
    menu_height = 0.0 if app.scene is None else imgui.get_frame_height()
    _floating("training panel", (float(right), 0.0), top=menu_height)
    app.gui.guarded(training_panel, app)
    app.gui.claim()
    imgui.end()


def loading_window(title: str, progress) -> None:
    """The stages of a loading.Progress, with a bar."""
    _floating("loading", (0.5, 0.5), imgui.WindowFlags_.no_inputs.value)
    imgui.text(readable(title))
    done = list(progress.seconds)  # another thread adds to it
    for stage, seconds in zip(STAGES, done, strict=False):
        imgui.text_disabled(f"{stage}, {seconds:.1f} s")
    imgui.text(f"{progress.stage}, {progress.stage_seconds:.0f} s")
    for stage in STAGES[len(done) + 1 :]:
        imgui.text_disabled(stage)
    imgui.progress_bar(progress.fraction, (BAR_WIDTH, 0.0), f"{progress.fraction:.0%}")
    if progress.compiled:
        imgui.text_disabled("kernels are compiled on the first start only")
    imgui.end()
