"""Where the panels lie: menus above, tools at the left, the task's panel, the status line below.

While a model is loaded or a session plays, a window shows the progress.
"""

from imgui_bundle import imgui, imgui_ctx

from ..camera import Covered, film_frame
from ..files import readable
from ..loading import STAGES
from ..parts import call
from .dialogs import dialog_window, leaving_window, recovery_window
from .film import RECORDING_RED, film_window, progress_window, recording_line
from .help import help_size, help_window
from .inspector import inspector
from .menu import menu_bar
from .overlays import box_overlay, brush_overlay, frame_overlay, gesture_overlay, gizmo_overlay
from .status import pause_line, status_height, status_line
from .timeline import STRIP_HEIGHT, timeline_strip
from .tool_strip import strip_width, tool_strip
from .training import training_lines, training_panel

BAR_WIDTH = 360.0
MARGIN = 10.0
NARROW = 660.0  # points of the free part, where windows stand in the middle of all
LEAST_PANEL = 160.0  # points of height, or the timeline lies beside the task's panel
LEAST_VIEW = 260.0  # points that the panels leave to the view, if the window has them
FIRST_LINE = "Drag the object to bend it"  # until that has been done once
FLAGS = imgui.WindowFlags_
FLOATING = (
    FLAGS.no_decoration.value
    | FLAGS.no_saved_settings.value
    | FLAGS.always_auto_resize.value
    | FLAGS.no_nav.value
)
FIXED = FLOATING & ~FLAGS.always_auto_resize.value | FLAGS.no_move.value
PANEL = (  # a click must not bring it over the help; where it appears, a click elsewhere goes on
    FIXED | FLAGS.no_bring_to_front_on_focus.value | FLAGS.no_focus_on_appearing.value
)
OVERLAYS = box_overlay, gizmo_overlay, gesture_overlay, brush_overlay
QUESTIONS = {
    "leaving": leaving_window,
    "recovery": recovery_window,
    "dialog": dialog_window,
    "film": film_window,
}


class Panels:
    """All that lies over the view of one window."""

    def __init__(self, app):
        self._app, self._gui = app, app.gui
        self._said = "", ""  # the message, and the task in which it was said

    # -- where they lie ------------------------------------------------------------------

    def covered(self) -> Covered:
        """What menus and panels cover of the window."""
        settings = self._app.scene.settings
        bottom = STRIP_HEIGHT * settings.show_timeline
        left = right = 0.0
        if settings.show_panel:
            bottom += status_height()
            left, side = strip_width(), self._panel_width()
            left, right = (left + side, 0.0) if settings.panel_side == "left" else (left, side)
        return Covered(left, imgui.get_frame_height(), right, bottom)

    def _panel_width(self):
        width = imgui.get_io().display_size.x - strip_width() - LEAST_VIEW
        return max(min(self._app.scene.settings.panel_width, width), 180.0)

    def show(self, panel) -> None:
        """Draw a panel into the window that is being built, with what it asks for."""
        self._gui.guarded(panel, window=self._app)

    # -- a frame -------------------------------------------------------------------------

    def draw(self) -> None:
        gui, settings = self._gui, self._app.scene.settings
        covered, size = self.covered(), imgui.get_io().display_size
        has_timeline = settings.show_timeline  # a menu or button may change it in this frame
        for overlay in OVERLAYS:
            self.show(overlay)
        takes = self._app.takes
        if takes.shows_frame or takes.asking:
            frame_overlay(film_frame((size.x, size.y), covered, takes.aspect))
        gui.guarded(self.menus)
        is_low = size.y - covered.top - covered.bottom < LEAST_PANEL
        if settings.show_panel:
            self._frame(covered, covered.bottom - STRIP_HEIGHT * (has_timeline and is_low))
        if has_timeline:
            left, right = strip_width() * settings.show_panel, 0.0
            if is_low:
                left, right = covered.left, covered.right
            place = left, size.y - covered.bottom, size.x - left - right, STRIP_HEIGHT
            self._fixed("timeline", timeline_strip, place)
        self._floating_windows(covered)
        self._question(covered)

    def menus(self):
        """Guarded as a whole: ImGui recovers from no error of which a menu bar is left open."""
        if imgui.begin_main_menu_bar():
            call(menu_bar, self._app)
            self._gui.claim()
            imgui.end_main_menu_bar()

    def _frame(self, covered, below):
        """Tools, the task's panel with so much below it, the status line."""
        size, settings = imgui.get_io().display_size, self._app.scene.settings
        top, low, side = covered.top, status_height(), self._panel_width()
        tools = 0.0, top, strip_width(), size.y - top - low
        self._fixed("tools", tool_strip, tools, padding=0.5)
        left = strip_width() if settings.panel_side == "left" else size.x - side
        self._fixed("task", inspector, (left, top, side, size.y - top - below))
        self._fixed("status", status_line, (0.0, size.y - low, size.x, low), padding=0.4)

    def _fixed(self, name, panel, place, padding=1.0):
        """A window at a place (left, top, width, height) that fills it."""
        style = imgui.get_style()
        x, y = style.window_padding
        imgui.push_style_var(imgui.StyleVar_.window_rounding.value, 0.0)
        imgui.push_style_var(imgui.StyleVar_.window_padding.value, (padding * x, padding * y))
        imgui.push_style_var(imgui.StyleVar_.window_min_size.value, (1.0, 1.0))
        imgui.set_next_window_pos(place[:2])
        imgui.set_next_window_size((max(place[2], 1.0), max(place[3], 1.0)))
        imgui.begin(name, flags=PANEL)
        imgui.pop_style_var(3)
        self.show(panel)
        self._gui.claim()
        imgui.end()

    def _floating_windows(self, covered):
        app, settings = self._app, self._app.scene.settings
        if settings.show_help and not app.questions.name:
            imgui.set_next_window_size(help_size())
            imgui.set_next_window_bg_alpha(1.0)  # it may lie over the panel
            self._floating("help", (0.5, 0.5), help_window, FIXED, covered)
        if app.takes.job is not None:
            self._floating("film's progress", (1.0, 1.0), progress_window, FLOATING, covered)
        if app.train_job is not None and settings.show_panel:
            self.training_window()
        self._tell(covered)

    def _tell(self, covered):
        """Lines over the view; some only where no panel says the same, and one at a place."""
        app, settings, places = self._app, self._app.scene.settings, set()
        hidden, job = not settings.show_panel, app.train_job
        asks, message = settings.show_help or app.questions.name, app.recorder.message
        begun = settings.has_dragged or app.photographs or asks
        if message != self._said[0]:
            self._said = message, settings.task
        for name, place, wanted, line in (
            ("recording", (1.0, 0.0), hidden, recording_line(app.takes, app.recorder)),
            ("training", (0.5, 0.0), hidden and job, job and training_lines(job)[0]),
            ("flying", (0.5, 0.0), hidden and app.fly.on, app.fly.line),
            ("tool", (0.5, 0.0), not asks, app.controls.tool.told),
            ("paused", (0.5, 0.0), not asks, call(pause_line, app)),
            ("first minute", (0.5, 0.0), settings.tool == "grab" and not begun, FIRST_LINE),
            ("photographed", (0.0, 1.0), settings.show_photographed, app.photographed.told),
            ("message", (0.5, 1.0), self._said[1] == settings.task, message),
        ):
            if wanted and line and place not in places:
                places.add(place)
                _begin_told(name, place, covered)
                if name == "recording":
                    imgui.text_colored(RECORDING_RED, line)
                else:
                    imgui.text(line)
                imgui.end()

    def _floating(self, name, place, panel, flags, covered):
        _set_place(place, covered)
        with imgui_ctx.begin(name, flags=flags):
            self.show(panel)
            self._gui.claim()

    def _question(self, covered):
        """The window in the middle that asks something: one after another."""
        name = self._app.questions.name
        if name == "film":  # beside the picture, which shows what it will be
            _set_place((1.0, 0.5), Covered())
        elif name:
            _set_place((0.5, 0.5), covered)
        with self._gui.dialog(name, FLOATING) as shown:
            if shown:
                self.show(QUESTIONS[name])

    # -- alone on a plain ground ---------------------------------------------------------

    def playing_window(self, tick: int, patience) -> None:
        """How far a session has been played, and whether to go on if that takes long."""
        ticks = max(patience.total, 1)
        _begin_told("loading", (0.5, 0.5), Covered())
        imgui.text(f"playing the session, {tick // 60} of {ticks // 60} s")
        imgui.progress_bar(tick / ticks, (BAR_WIDTH, 0.0), patience.line(tick))
        asks = patience.asks(tick)
        imgui.text("This takes long. Enter: go on; Esc: stop" if asks else "Esc: stop")
        imgui.end()

    def training_window(self) -> None:
        """How a training run goes, beside the panel."""
        covered = Covered() if self._app.scene is None else self.covered()
        self._floating("training panel", (0.0, 0.0), training_panel, FLOATING, covered)

    def loading_window(self, title: str, progress) -> None:
        """The stages of a loading.Progress, with a bar."""
        _begin_told("loading", (0.5, 0.5), Covered())
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


def _set_place(place, covered):
    """Put the next window into the free part: its middle at (0.5, 0.5), at the bottom (0.5, 1)."""
    size, inwards = imgui.get_io().display_size, {0.0: MARGIN, 0.5: 0.0, 1.0: -MARGIN}
    if place == (0.5, 0.5):
        wide = size.x - covered.left - covered.right >= NARROW
        covered = Covered(covered.left, 0.0, covered.right, 0.0) if wide else Covered()
    x = covered.left + place[0] * (size.x - covered.left - covered.right) + inwards[place[0]]
    y = covered.top + place[1] * (size.y - covered.top - covered.bottom) + inwards[place[1]]
    imgui.set_next_window_pos((x, y), pivot=place)


def _begin_told(name, place, covered):
    """Begin a window that only tells something: the mouse and keys pass it."""
    _set_place(place, covered)
    flags = FLOATING | FLAGS.no_inputs.value | FLAGS.no_focus_on_appearing.value
    imgui.begin(name, flags=flags)
    # Also where a click has brought the window that has the keys to the front.
    imgui.internal.bring_window_to_display_front(imgui.internal.get_current_window())
