"""The window's own loop, with panels: synthetic events in a window without a display."""

import gc
import time
import weakref
from types import SimpleNamespace

import av
import numpy as np
import pytest
from PIL import Image

from deformrf.core.render import RenderOptions
from deformrf.viewer.camera import picking
from deformrf.viewer.settings import TASKS

pytestmark = pytest.mark.gl


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    """An App with panels in a window without a display, ready, with its events in `log`."""
    from deformrf.viewer.app import App

    class Log(list):
        enabled = False

        def __call__(self, event, **fields):
            self.append((event, fields))

    monkeypatch.chdir(tmp_path)
    made = App(*window, Log())
    made.load(ball, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.5
    frames(made, 3)
    yield made
    made.close()


def frames(app, count):
    app.run(app.frame_count + count)


def send(app, name, *arguments):
    app.window.dispatch_event(name, *arguments)
    app.window.dispatch_events()


def view_point(app, vertex):
    """A vertex in pyglet's coordinates."""
    camera = app.controls.camera
    (at,), _ = picking.project(camera, app.scene.handles.at([vertex]))
    return round(at[0]), round(app.window.height - 1 - at[1])


def free_vertex(app):
    """A visible control vertex that no panel covers."""
    for vertex in app.scene.handles.control_ids[app.controls.shown(app.scene.handles.control_ids)]:
        if not app.gui.covers(*view_point(app, vertex)):
            return int(vertex)
    pytest.fail("the panel covers every vertex")


@pytest.fixture
def bare(app):
    """The same without panels in the way."""
    app.scene.settings.show_panel = False
    frames(app, 2)
    return app


def test_pressing_and_moving_bends_the_object(bare):
    from pyglet.window import mouse

    vertex = free_vertex(bare)
    x, y = view_point(bare, vertex)
    send(bare, "on_mouse_motion", x, y, 0, 0)
    assert bare.scene.handles.hover == vertex
    send(bare, "on_mouse_press", x, y, mouse.LEFT, 0)
    send(bare, "on_mouse_drag", x + 20, y + 15, 20, 15, mouse.LEFT, 0)
    time.sleep(0.04)
    frames(bare, 3)
    assert view_point(bare, vertex) == pytest.approx((x + 20, y + 15), abs=1)
    send(bare, "on_mouse_release", x + 20, y + 15, mouse.LEFT, 0)
    assert [name for name, _ in bare.log][-2:] == ["grab", "release"]


def test_a_line_says_how_to_begin_until_a_red_point_has_been_dragged(bare, monkeypatch):
    from imgui_bundle import imgui
    from pyglet.window import mouse

    monkeypatch.setattr("deformrf.viewer.app.PANEL_SECONDS", 0.0)  # also during the drag

    def is_shown():
        frames(bare, 2)
        line = imgui.internal.find_window_by_name("first minute")
        return line is not None and line.was_active

    x, y = view_point(bare, free_vertex(bare))
    assert is_shown() and not bare.gui.covers(bare.window.width // 2, bare.window.height - 50)
    bare.scene.settings.show_help = True
    assert not is_shown()
    bare.scene.settings.show_help = False
    send(bare, "on_mouse_press", x, y, mouse.LEFT, 0)
    send(bare, "on_mouse_drag", x + 9, y, 9, 0, mouse.LEFT, 0)
    assert is_shown()
    send(bare, "on_mouse_release", x + 9, y, mouse.LEFT, 0)
    assert not is_shown()


def test_the_list_of_keys_shrinks_with_the_window(bare):
    """In full letters it is ten times as wide as this one; an advance is a pixel at least."""
    from imgui_bundle import imgui

    bare.scene.settings.show_help = True
    frames(bare, 3)
    keys = imgui.internal.find_window_by_name("help")
    assert keys.content_size_ideal.x < 2.0 * bare.window.width


def test_the_panel_names_the_vertex_under_the_mouse_and_the_one_held(bare):
    from pyglet.window import mouse

    from deformrf.viewer.panels.bend import vertex_line

    vertex = free_vertex(bare)
    at = view_point(bare, vertex)
    shown = bare.scene.handles
    title = shown.title(vertex)
    assert vertex_line(shown) == "nothing selected"
    send(bare, "on_mouse_motion", *at, 0, 0)
    assert vertex_line(shown) == f"nothing selected; mouse on {title}"
    send(bare, "on_mouse_press", *at, mouse.LEFT, 0)
    send(bare, "on_mouse_drag", at[0] + 9, at[1], 9, 0, mouse.LEFT, 0)
    assert vertex_line(shown) == f"holding {title}"
    send(bare, "on_mouse_release", *at, mouse.LEFT, 0)


def test_escape_ends_the_drag_and_not_the_program(bare):
    from pyglet.window import key, mouse

    x, y = view_point(bare, free_vertex(bare))
    send(bare, "on_mouse_press", x, y, mouse.LEFT, 0)
    send(bare, "on_mouse_drag", x + 9, y, 9, 0, mouse.LEFT, 0)
    assert bare.scene.handles.grabbed is not None
    send(bare, "on_key_press", key.ESCAPE, 0)
    assert bare.scene.handles.grabbed is None
    assert not bare.window.has_exit
    send(bare, "on_key_press", key.Q, key.MOD_CTRL)
    assert bare.window.has_exit


def test_a_press_on_the_panel_stays_there(app):
    from pyglet.window import mouse

    orbit = app.scene.orbit
    inside = app.window.width - 60, app.window.height - 60
    assert app.gui.covers(*inside)
    send(app, "on_mouse_press", *inside, mouse.LEFT, 0)
    send(app, "on_mouse_drag", 70, 100, 10, -80, mouse.LEFT, 0)
    send(app, "on_mouse_release", 70, 100, mouse.LEFT, 0)
    send(app, "on_mouse_scroll", *inside, 0, 3)
    assert app.scene.orbit is orbit
    assert app.scene.handles.grabbed is None


WIDGETS = (
    *("button", "checkbox", "combo", "color_edit3", "slider_float", "slider_int"),
    "collapsing_header",
)


@pytest.fixture
def widgets(monkeypatch):
    """Everything that the panels have drawn: (label, id, middle in ImGui's coordinates)."""
    from imgui_bundle import imgui

    drawn = []

    def noted(draw):
        def draw_and_note(label, *arguments, **options):
            result = draw(label, *arguments, **options)
            low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
            at = round(0.5 * (low.x + high.x)), round(0.5 * (low.y + high.y))
            drawn.append((label, imgui.get_item_id(), at))
            return result

        return draw_and_note

    for name in WIDGETS:
        monkeypatch.setattr(imgui, name, noted(getattr(imgui, name)))
    return drawn


def test_no_two_widgets_have_the_same_id(app, widgets, monkeypatch):
    for task in TASKS:
        app.scene.settings.task = task
        frames(app, 2)
        widgets.clear()
        frames(app, 1)
        ids = [identity for _, identity, _ in widgets]
        assert len(ids) > 15
        assert len(set(ids)) == len(ids), task


def test_the_clip_button_starts_and_ends_a_clip(app, widgets, monkeypatch, tmp_path):
    app.scene.settings.task = "film"
    frames(app, 3)
    click(app, [at for label, _, at in widgets if label == "Record the screen"][-1])
    assert app.recorder.video is not None
    frames(app, 3)
    click(app, [at for label, _, at in widgets if label == "Stop recording the screen"][-1])
    assert app.recorder.video is None
    assert len(list(tmp_path.glob("deformrf-*.mp4"))) == 1


def click(app, at):
    """Move to a point in ImGui's coordinates, press and let go."""
    from pyglet.window import mouse

    x, y = at[0], app.window.height - 1 - at[1]
    send(app, "on_mouse_motion", x, y, 0, 0)
    frames(app, 2)
    send(app, "on_mouse_press", x, y, mouse.LEFT, 0)
    frames(app, 2)
    send(app, "on_mouse_release", x, y, mouse.LEFT, 0)
    frames(app, 2)


def test_keys_do_what_the_table_says(bare):
    from pyglet.window import key

    scene = bare.scene
    send(bare, "on_key_press", key.SPACE, 0)
    assert scene.clock.paused
    send(bare, "on_key_press", key.W, 0)
    assert scene.settings.show_wireframe
    send(bare, "on_key_press", key.TAB, 0)
    assert scene.settings.show_panel
    send(bare, "on_key_press", key.F1, 0)
    assert scene.settings.show_help
    frames(bare, 2)  # panel and help can be drawn


def test_a_live_clip_lasts_as_long_as_it_was_recorded(bare, tmp_path):
    from pyglet.window import key

    send(bare, "on_key_press", key.F9, key.MOD_SHIFT)
    start = time.monotonic()
    while time.monotonic() - start < 1.0:
        frames(bare, 1)
    send(bare, "on_key_press", key.F9, key.MOD_SHIFT)
    seconds = time.monotonic() - start
    (clip,) = tmp_path.glob("deformrf-*.mp4")
    with av.open(str(clip)) as container:
        stream = container.streams.video[0]
        assert float(stream.duration * stream.time_base) == pytest.approx(seconds, abs=0.1)
        assert (stream.width, stream.height) == (320, 240)


def screenshot(app):
    """What the next frame writes.  [H, W, 3] int"""
    app.recorder.screenshot()
    frames(app, 1)
    return np.asarray(Image.open(app.recorder.written[-1])).astype(int)


def test_a_screenshot_has_the_panel_only_if_asked_for(app, tmp_path):
    pictures = []
    for with_panel in (False, True):
        app.scene.settings.panel_in_screenshots = with_panel
        pictures.append(screenshot(app))
    plain, panel = pictures
    changed = abs(plain - panel).max(axis=-1) > 8
    assert plain.shape == (240, 320, 3)
    assert changed[:, :100].mean() > 0.1


def test_handles_are_in_the_picture_only_if_asked_for(bare):
    pictures = []
    for with_handles in (True, False):
        bare.scene.settings.handles_in_clips = with_handles
        pictures.append(screenshot(bare))
    assert (abs(pictures[0] - pictures[1]).max(axis=-1) > 60).sum() > 100


def test_a_transparent_screenshot_is_the_field_in_full_whatever_is_in_the_window(app):
    settings = app.scene.settings
    settings.transparent_screenshots = settings.panel_in_screenshots = True
    settings.background, settings.fixed_resolution = (0.2, 0.6, 0.1), 0.25
    picture = screenshot(app)
    assert picture.shape == (240, 320, 4)
    image = app.radiance._renderer.render(app.controls.camera, RenderOptions((0.0, 0.0, 0.0)))
    wanted = image.color_array().astype(int)
    assert np.array_equal(picture[..., 3], wanted[..., 3])
    own = picture[..., :3] * picture[..., 3:] / 255
    assert abs(own - wanted[..., :3]).max() <= 2
    assert app.radiance.refined == 1.0


def until(app, condition, seconds=60.0):
    """Run the loop as a user has it, until something holds."""
    end = time.monotonic() + seconds
    switch_to = app.window.switch_to

    def watched():
        if condition():
            app.window.has_exit = True
        assert time.monotonic() < end
        switch_to()

    app.window.switch_to = watched
    app.run()
    app.window.has_exit, app.window.switch_to = False, switch_to


def rest(app):
    """Run until nothing is left to draw."""
    until(app, lambda: app.radiance.settled and app._quiet(time.perf_counter()))


def test_at_rest_hardly_a_frame_is_drawn_and_nothing_is_rendered(app):
    rest(app)
    assert app.radiance.sample_count == 16
    start, frame_count, cpu = time.monotonic(), app.frame_count, time.process_time()
    app.radiance._renderer.render = None  # would fail if called
    until(app, lambda: time.monotonic() - start > 3.0)
    assert 2 <= app.frame_count - frame_count <= 5
    assert time.process_time() - cpu < 1.0


def test_while_samples_are_added_frames_are_drawn_only_for_whole_ones(app):
    until(app, lambda: app.radiance.refined == 1.0)
    app.last_event = 0.0
    before, start = app.frame_count, time.monotonic()
    rest(app)
    assert app.radiance.sample_count == 16
    assert app.frame_count - before <= 15 + 2 * (time.monotonic() - start) + 3


@pytest.mark.parametrize("at", ["panel", "view"])
def test_a_mouse_event_anywhere_makes_the_loop_draw_again(app, at):
    app.scene.settings.show_panel = at == "panel"
    rest(app)
    x, y = app.window.width - 60, app.window.height - 90
    assert app.gui.covers(x, y) == (at == "panel")
    frame_count = app.frame_count
    app.window.dispatch_event("on_mouse_motion", x, y, 0, 0)
    start = time.monotonic()
    until(app, lambda: time.monotonic() - start > 0.5)
    assert app.frame_count - frame_count > 8


def test_a_pause_does_not_count_as_a_slow_frame(app):
    rest(app)
    start = time.monotonic()
    until(app, lambda: time.monotonic() - start > 1.2)
    assert max(app.times.frames) < 1.0


def test_the_panel_says_what_the_picture_is(app):
    from deformrf.viewer.panels.view import shown_lines

    pixels, state = shown_lines(app.radiance, app.times)
    assert pixels.startswith("50%, pixels 2.0 wide, ")
    assert state.endswith("% refined") and state != "100% refined"
    rest(app)
    pixels, state = shown_lines(app.radiance, app.times)
    assert pixels.startswith("100%, pixels 1.0 wide, ")
    assert state == "full + 16/16 samples"
    coarse = SimpleNamespace(
        factor=0.5,
        refined=0.4,
        shown=SimpleNamespace(cheaper={"step_factor": 2.0, "level_count": 4}),
    )
    assert shown_lines(coarse, app.times)[1] == "40% refined, steps × 2.0, 4 levels"


def test_the_panel_says_when_the_object_is_slower_than_the_clock(app, monkeypatch):
    from imgui_bundle import imgui

    from deformrf.viewer.panels import inspector
    from deformrf.viewer.panels.view import SHOWN_TOOLTIP, shown_lines

    shown = [one._replace(is_open=True) for one in inspector.SECTIONS["view"]]
    monkeypatch.setitem(inspector.SECTIONS, "view", shown)
    app.scene.settings.task = "view"
    tooltips = []
    monkeypatch.setattr(imgui, "set_item_tooltip", tooltips.append)
    app.scene.handles.grab(int(app.scene.handles.control_ids[0]))
    app.frame(1.0 / 60.0)
    assert "object time" not in shown_lines(app.radiance, app.times)[1]
    for _ in range(3):
        app.scene.handles.drag_to(app.scene.handles.grabbed.target.place + np.array([0.05, 0, 0]))
        app.frame(0.5)  # of which 0.1 s are simulated
    assert "object time × 0.2" in shown_lines(app.radiance, app.times)[1]
    assert SHOWN_TOOLTIP in tooltips


def test_m_goes_through_the_modes(bare):
    from pyglet.window import key

    from deformrf.core.render import MODES

    seen = []
    for _ in MODES:
        send(bare, "on_key_press", key.M, 0)
        seen.append(bare.scene.settings.mode)
        frames(bare, 1)
    assert seen == [*MODES[1:], MODES[0]]


def test_stages_of_rendering_are_shown_if_asked_for(app, monkeypatch):
    from imgui_bundle import imgui

    from deformrf.viewer.panels import inspector

    shown = [one._replace(is_open=True) for one in inspector.SECTIONS["view"]]
    monkeypatch.setitem(inspector.SECTIONS, "view", shown)
    app.scene.settings.task = "view"
    lines = []
    monkeypatch.setattr(imgui, "text_disabled", lines.append)
    app.scene.settings.time_rendering = True
    app.scene.settings.background = (0.5, 0.5, 0.5)
    frames(app, 2)
    assert {"march", "shade"} <= set(lines)
    app.scene.settings.time_rendering = False
    lines.clear()
    frames(app, 1)
    assert "shade" not in lines
    assert "render" in lines


def test_closing_the_window_ends_the_loop(bare):
    bare.window.dispatch_event("on_close")
    bare.run()
    assert bare.window.has_exit


def test_while_thin_parts_are_fitted_time_stands_and_it_is_said(app, monkeypatch):
    scene = app.scene
    monkeypatch.setattr(type(scene.clock), "waits", True)
    scene.solver.grab(np.flatnonzero(~scene.solver.pinned)[:1])
    before = scene.journal.tick, scene.solver.vertices.numpy()
    for _ in range(3):
        app.frame(0.1)
    assert scene.journal.tick == before[0] and "thin parts" in app.recorder.message
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), before[1])
    monkeypatch.setattr(type(scene.clock), "waits", False)
    app.frame(0.1)
    assert scene.journal.tick > before[0]


def test_what_actions_and_panels_ask_for_is_in_a_window(app):
    """Their parameters name parts: a wrong name would fail at the first click."""
    from deformrf.viewer.actions import ACTIONS
    from deformrf.viewer.panels import inspector, window
    from deformrf.viewer.parts import parameters_of, part

    functions = [*window.OVERLAYS, *window.QUESTIONS.values()]
    functions += [one.panel for all_of in inspector.SECTIONS.values() for one in all_of]
    functions += [one for act in ACTIONS.values() for one in (act.function, act.on) if one]
    assert len(functions) > 100
    for function in functions:
        for name in parameters_of(function):
            part(app, name)


def test_what_no_photograph_saw_is_marked_if_the_model_says_where_they_were_taken(
    bare, monkeypatch
):
    from deformrf.core.render import Lens, look_at, rows_of_views

    scene = bare.scene
    bare.actions.call("toggle_photographed")
    assert "does not say where" in bare.recorder.message
    assert not bare.actions.is_on("toggle_photographed")
    pose = look_at(2.0 * scene.center - bare.controls.camera.position, scene.center)  # from behind
    views = rows_of_views(pose[None], [Lens(64, 64, (90.0, 90.0), (32.0, 32.0))])
    monkeypatch.setitem(scene.field.meta, "views", views)
    bare.actions.call("toggle_photographed")
    frames(bare, 1)
    assert bare.photographed.busy and "%" in bare.photographed.told
    renderer = weakref.ref(bare.photographed._work.gi_frame.f_locals["renderer"])
    bare.actions.call("toggle_photographed")  # halfway off again
    frames(bare, 1)
    gc.collect()
    assert renderer() is None and not bare.photographed.busy
    bare.actions.call("toggle_photographed")
    for _ in range(200):
        frames(bare, 1)
        if not bare.photographed.busy:
            break
    bare.draw(bare.controls.camera)
    marked = bare.canvas.read().astype(int)
    bare.actions.call("toggle_photographed")
    bare.draw(bare.controls.camera)
    assert (abs(bare.canvas.read() - marked).max(axis=-1) > 30).sum() > 500


def test_a_tool_that_works_something_out_says_so_and_keeps_the_window_awake(bare):
    bare.scene.settings.tool = "isolate"
    frames(bare, 1)
    tool = bare.controls.tool
    assert tool.busy
    bare.last_event = -1e9
    assert not bare._quiet(bare._drawn_at + 0.5)
    while tool.busy:
        frames(bare, 1)
    assert tool.told == "Click the object"


def test_the_status_line_says_which_keys_change_a_drag(bare):
    from pyglet.window import key, mouse

    from deformrf.viewer.panels.status import hint_of

    def hint():
        return hint_of(bare.controls, bare.fly, bare.actions)

    vertex = free_vertex(bare)
    x, y = view_point(bare, vertex)
    assert hint().startswith("Bend: Drag the object or a red point")
    bare.scene.handles.select([vertex])
    assert hint().startswith("Bend: Drag a selected point")
    send(bare, "on_mouse_press", x, y, mouse.LEFT, 0)
    send(bare, "on_mouse_drag", x + 9, y, 9, 0, mouse.LEFT, 0)
    assert hint().endswith("   E: turn   S: scale   P: pin it there")
    send(bare, "on_key_press", key.E, 0)
    assert hint().endswith("   E: move again   S: scale   P: pin it there")
    send(bare, "on_mouse_release", x + 9, y, mouse.LEFT, 0)
