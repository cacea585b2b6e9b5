"""The log file, and errors that a user is told of."""

import functools
import logging
from dataclasses import replace

import pytest

from deformrf.viewer import logs
from deformrf.viewer.files import Problem


@pytest.fixture
def log_file(tmp_path):
    path = logs.start(tmp_path / "logs" / "viewer.log")
    yield path
    logs.stop()


def test_warnings_and_errors_of_all_modules_are_written(log_file):
    logging.getLogger("deformrf.anywhere").warning("this happened")
    try:
        raise KeyError("no such thing")
    except KeyError as error:
        logs.note(error)
    text = log_file.read_text()
    assert text.splitlines()[0].count("deformrf") >= 1  # version and system
    assert "WARNING deformrf.anywhere: this happened" in text
    assert "Traceback" in text and "KeyError: 'no such thing'" in text


def test_the_file_does_not_grow_without_end(log_file):
    for _ in range(40):
        logging.getLogger("deformrf").warning("x" * 100_000)
    sizes = [path.stat().st_size for path in log_file.parent.iterdir()]
    assert len(sizes) == 1 + logs.OLDER and max(sizes) <= logs.LARGEST


def test_a_folder_that_cant_be_written_stops_nothing(tmp_path, caplog):
    (tmp_path / "file").touch()
    assert logs.start(tmp_path / "file" / "viewer.log") is None
    assert "no log" in caplog.text


# -- in the viewer -----------------------------------------------------------------------------


@pytest.fixture
def app(window, ball, log_file, monkeypatch, tmp_path):
    """An App with panels in a window without a display, and a log."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    monkeypatch.chdir(tmp_path)
    made = App(*window, EventLog(False))
    made.log_file = made.gui.log_file = log_file
    made.load(ball, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.25
    made.run(2)
    yield made
    made.close()


def run_until_closed(app, frame_count):
    """The user's loop, closed after that many frames."""
    end, drawn = app.frame_count + frame_count, app.gui.end

    def counted():
        drawn()
        app.window.has_exit = app.frame_count >= end

    app.gui.end = counted
    try:
        app.run()
    finally:
        app.gui.end, app.window.has_exit = drawn, False


@pytest.mark.gl
@pytest.mark.parametrize("place", ["frame", "event", "panels"])
def test_an_error_is_told_of_with_the_logs_name_and_the_viewer_goes_on(
    app, log_file, monkeypatch, place
):
    from pyglet.window import key

    from deformrf.viewer.actions import ACTIONS

    failures = ["by chance"]

    def failing_once(function):
        def call(*arguments, **named):
            if failures:
                raise ZeroDivisionError(failures.pop())
            return function(*arguments, **named)

        return call

    if place == "frame":
        app.scene.clock.advance = failing_once(app.scene.clock.advance)
    elif place == "event":
        undo = ACTIONS["undo"].function
        failing = functools.wraps(undo)(failing_once(undo))
        monkeypatch.setitem(ACTIONS, "undo", replace(ACTIONS["undo"], function=failing))
        app.window.dispatch_event("on_key_press", key.Z, key.MOD_CTRL)
    else:
        app.panels.draw = failing_once(app.panels.draw)
    run_until_closed(app, 4)
    assert "ZeroDivisionError: by chance" in log_file.read_text()
    if place != "panels":  # these say it in their own place
        assert app.questions.dialog == Problem(
            "Something went wrong", "ZeroDivisionError: by chance", log_file
        )


@pytest.mark.gl
def test_errors_that_dont_end_end_the_viewer(app, log_file):
    def fail(*arguments):
        raise ZeroDivisionError("always")

    app.scene.clock.advance = fail
    with pytest.raises(ZeroDivisionError):
        run_until_closed(app, 4)


@pytest.mark.gl
def test_a_number_of_frames_is_drawn_without_errors_or_not_at_all(app):
    def fail(*arguments):
        raise ZeroDivisionError("once is enough")

    app.scene.clock.advance = fail
    with pytest.raises(ZeroDivisionError):
        app.run(app.frame_count + 1)
