"""Sessions that are played in the window: one that is opened, and one that was left behind.

Playing may take minutes.  The window shows how far it is, and Esc or closing it ends the playing,
which leaves the scene as it was.
"""

import time

from pyglet.window import key

from .document import (
    Patience,
    Player,
    Project,
    Session,
    open_session,
    play_patiently,
    start_of,
)

SILENT_SECONDS = 0.2  # between two pictures of how far it is
ANSWER_SECONDS = 0.05  # between two pictures of the question


class _Stopped(Exception):
    """The user has ended the playing."""


class Playing:
    """Plays sessions in one window."""

    def __init__(self, app):
        self._app = app

    def play(self, session: Session, said: str = "", project: Project | None = None) -> bool:
        """Bring the App's scene to where a session ended, from which it goes on and can be undone.

        What was done to the scene before is kept in a file, as that of a viewer that did not end in
        order is.

        Args:
            said: What to say then.
            project: That has the session, and the model that is shown: it is open then.

        Returns:
            False if the user has stopped it; the scene is as it was.

        Raises:
            SessionError: It is damaged, or of another stiffness; the scene stays as it was.
        """
        app = self._app
        scene, before = app.scene, app.autosave
        sentences = [] if before is None else before.keep()
        try:
            with scene.states.unless_it_fails():
                scene.states.begin_anew()
                usual = start_of(scene)
                start = usual | session.header["start"]
                self._play(Player(scene, session))
        except _Stopped:
            app.recorder.say("the session was stopped: all is as it was before")
            return False
        scene.journal.mark_saved()
        app.session_start = start
        app.takes.forget()
        scene.handles.release()
        scene.end_push()
        if scene.timeline.playing:
            scene.timeline.stop()
        app.project = None if project is None else project.path
        if project is not None:  # all is as it was saved
            project.apply_looks(scene)
        elif scene.clock.paused and not scene.timeline.stands:  # else a pose is shown, and stays
            scene.clock.paused = False
        if before is not None:
            app.begin_autosave()
            sentences += app.autosave.write()
            if not before.kept:
                before.end()
        integrator = start["integrator"]
        earlier = f"it plays with the integrator that it was made with ({integrator})"
        told = said, earlier * (integrator != usual["integrator"])
        sentences = [*filter(None, told), *sentences]
        if sentences:
            app.recorder.say("; ".join(sentences))
        return True

    def begin_anew(self) -> None:
        """Go on with the model as it was opened; what was done is kept for another start."""
        self.play(Session({"start": {}, "ticks": 0}, []), "begun anew")

    def _play(self, player):
        """Play all of a session; raises _Stopped."""
        app = self._app
        ticks = player.session.ticks
        if app.gui is None:
            play_patiently(player, ticks)
            return
        patience, stopped, shown = Patience("playing", ticks), [], time.perf_counter()

        def on_key_press(symbol, modifiers):
            if symbol == key.ESCAPE:
                stopped.append(symbol)
            elif symbol in (key.ENTER, key.NUM_ENTER) and asking:
                patience.agreed = True
            return True

        def ended():
            return stopped or app.closing or app.window.has_exit

        window = app.panels.playing_window
        with app.only_shown(on_key_press=on_key_press):
            for done in player.batches(ticks):
                asking = patience.asks(done)
                if asking or time.perf_counter() - shown > SILENT_SECONDS:
                    app.show_alone(window, done, patience)  # which handles events
                    shown = time.perf_counter()
                else:
                    app.window.dispatch_events()
                while asking and not (patience.agreed or ended()):
                    time.sleep(ANSWER_SECONDS)
                    app.show_alone(window, done, patience)
                if ended():
                    raise _Stopped

    def recover(self) -> None:
        """Go on with the session that was left behind."""
        app, questions = self._app, self._app.questions
        path, questions.left_behind = questions.left_behind, None
        try:
            opened = open_session(path, app.scene.field, app.scene.source, whole=False)
            app.opening.show_model(opened.field, opened.source)
            questions.left_behind = None
            if not self.play(opened.session, opened.said):
                questions.left_behind = path
                return
            app.scene.journal.mark_saved(False)  # no file of the user's has it
            if app.autosave.path.exists():  # it has all of it
                path.unlink(missing_ok=True)
        except (OSError, ValueError) as error:  # a SessionError is one
            app.recorder.say(str(error))
