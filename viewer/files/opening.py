"""Files that the user opens: chosen in the window, dropped on it, or opened before.

Nothing is loaded in the middle of an event or of a frame's panels: `asked` is the path, and
the next frame begins with `open_asked`.  A file that can't be opened leaves the scene as it is.
"""

import logging
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

from ...core import field as fields
from ...core.base.arguments import plain_message
from ...core.base.paths import PROJECT, ROOT, free_name, is_project
from ...core.base.streams import printable
from ...core.training import has_cameras, photo_folder
from ...wings import capture
from .. import logs
from ..document import load_project, open_session
from .dialogs import FileDialog, NativeDialog, Problem

MODEL, SESSION = ".npz", ".jsonl"
log = logging.getLogger(__name__)


def needs_training(path: Path) -> bool:
    """Whether these are photographs, or a video, whose cameras no file has."""
    if capture.is_video(path):
        return True
    return path.is_dir() and not has_cameras(path) and photo_folder(path) is not None


class Opening:
    """Opens files in one window.

    Attributes:
        asked: The path to open next, or None.
        native: Whether to show the system's dialogs.
    """

    def __init__(self, app):
        self.asked: Path | None = None
        self.native = False
        self._app, self._dialog = app, None

    def ask(self) -> None:
        """Let the user choose a project, model or session."""
        chosen = partial(setattr, self, "asked")
        self._show("Open", self.folder, (PROJECT, MODEL, SESSION), chosen)

    def ask_where(self, save: Callable[[Path], str]) -> None:
        """Let the user choose where to save a project; `save` returns a sentence if it can't be."""
        path = self.path
        self._show("Save as", path.parent, (PROJECT,), save, path.name)

    def _show(self, title, folder, endings, chosen, name=""):
        if not self.native:
            self._app.questions.dialog = FileDialog(title, folder, endings, chosen, name)
        elif self._dialog is None:
            self._dialog = NativeDialog(title, folder / name, endings, bool(name), chosen)

    @property
    def path(self) -> Path:
        """Where a project is saved: in the open one, else under a free name where dialogs begin."""
        return self._app.project or free_name(self.folder / self._app.scene.name, PROJECT)

    @property
    def folder(self) -> Path:
        """Where a dialog begins: at the project, at what was opened last, or at home."""
        recent = [Path(name).parent for name in self._app.preferences.recent]
        project = self._app.project
        places = [*([project.parent] if project else []), *recent]
        own = (path for path in places if os.path.isdir(path) and not path.is_relative_to(ROOT))
        return next(own, Path.home())

    def follow(self) -> None:
        """Called many times a second: take what the dialog says, and open what was asked."""
        if self._dialog is not None and not self._dialog.follow():
            self._dialog = None
        if self.asked is not None and self._app.questions.leaving is None:
            self.open_asked()

    def open_asked(self) -> None:
        """Open what was asked for, in the place of what is shown."""
        app, path = self._app, self.asked
        self.asked = app.questions.dialog = None
        if path == app.questions.left_behind:
            app.playing.recover()
            return
        try:
            if not self._open(path):
                return
        except (OSError, ValueError, MemoryError) as error:
            sentence = plain_message(error) or "the memory is too small"
            log.warning("can't open %s: %s", path, sentence)
            self._tell(path, sentence)
        except Exception as error:  # Warp's and OpenGL's, as when a device's memory is too small
            log.exception("can't open %s", path)
            self._tell(path, logs.sentence(error), app.log_file)
        else:
            app.log("opened", path=path)
            app.preferences.opened(path)
            problem = app.preferences.save()
            if problem:
                app.recorder.say(problem)

    def _open(self, path):
        """Open a file or a folder; whether it is one that can be opened again."""
        app = self._app
        if needs_training(path):
            app.offer_training(path)
            return False
        if path.is_dir():
            self.open_photographs(path)
            return False
        if path.suffix.lower() == SESSION:
            opened = open_session(path, app.scene.field, app.scene.source)
            self.show_model(opened.field, opened.source)
            said = f"played {path.name}: go on, or undo it"
            return app.playing.play(opened.session, "; ".join(filter(None, [said, opened.said])))
        if is_project(path):
            project = load_project(path)
            self.show_model(project.field, project.source)
            said = "; ".join(filter(None, [f"opened {path.name}", project.said]))
            return app.playing.play(project.session, said, project)
        if path.suffix.lower() != MODEL:
            raise ValueError(
                f"{path} is no project ({PROJECT}), model ({MODEL}) or session ({SESSION}); "
                f"deformrf train makes a model of a data set's folder"
            )
        self.show_model(fields.load(path), path)
        return True

    def show_model(self, field, source: Path | None) -> None:
        """Show another model, of that file; nothing changes if it is the one that is shown."""
        app = self._app
        if field is app.scene.field:
            return
        on = app.loaded_on or (str(app.scene.solver.device), "auto")
        app.load(field, app.scene.name if source is None else source.stem, *on)
        app.scene.source = source

    def open_photographs(self, folder: Path, outside=False) -> None:
        """Take the photographs of the scene's data set from its folder.

        Args:
            outside: Also those that lie outside the folder.

        Raises:
            DatasetError: The folder is no data set, or has no photograph.
        """
        from ..camera import Photographs

        app = self._app
        app.photographs = Photographs(folder, app.scene.field.world_to_model, outside)
        for sentence in app.photographs.said:
            log.warning(printable(sentence))
        app.scene.settings.show_box = True
        app.recorder.say(f"{len(app.photographs)} photographs: [ and ] jump to their cameras")

    def _tell(self, path, sentence, log_file=None):
        self._app.log("problem", path=path, sentence=sentence)
        self._app.questions.dialog = Problem(f"Can't open {path.name}", sentence, log_file)
