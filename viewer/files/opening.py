"""Files that the user opens: chosen in the window, dropped on it, or opened before.

Nothing is loaded in the middle of an event or of a frame's panels: App.asked is the path, and
the next frame begins with `open_asked`.  A file that can't be opened leaves the scene as it is.
"""

import logging
import os
from pathlib import Path

from ...core import field as fields
from ...core.base.arguments import plain_message
from ...core.base.paths import PROJECT, is_project, working_folder
from ...core.base.streams import printable
from ...core.training import has_cameras, photo_folder
from ...wings import capture
from .. import logs
from ..document import load_project, open_session
from .dialogs import FileDialog, Problem

MODEL, SESSION = ".npz", ".jsonl"
log = logging.getLogger(__name__)


def ask_for_file(app) -> None:
    """Show the dialog to choose a project, model or session in."""
    recent = [Path(name).parent for name in app.preferences.recent]
    folder = next((path for path in recent if os.path.isdir(path)), working_folder())

    def chosen(path):
        app.asked = path

    app.dialog = FileDialog("Open", folder, (PROJECT, MODEL, SESSION), chosen)


def open_asked(app) -> None:
    """Open what was asked for: a project, a model or a session, in the place of what is shown."""
    path, app.asked = app.asked, None
    app.dialog = None
    if path == app.left_behind:
        app.recover()
        return
    try:
        if needs_training(path):
            app.offer_training(path)
            return
        if path.is_dir():
            open_photographs(app, path)
            return
        if path.suffix.lower() == SESSION:
            opened = open_session(path, app.scene.field, app.scene.source)
            show_model(app, opened.field, opened.source)
            said = f"played {path.name}: go on, or undo it"
            if not app.play(opened.session, "; ".join(filter(None, [said, opened.said]))):
                return
        elif is_project(path):
            project = load_project(path)
            show_model(app, project.field, project.source)
            said = "; ".join(filter(None, [f"opened {path.name}", project.said]))
            if not app.play(project.session, said, project):
                return
        elif path.suffix.lower() == MODEL:
            show_model(app, fields.load(path), path)
        else:
            raise ValueError(
                f"{path} is no project ({PROJECT}), model ({MODEL}) or session ({SESSION}); "
                f"deformrf train makes a model of a data set's folder"
            )
    except (OSError, ValueError, MemoryError) as error:
        sentence = plain_message(error) or "the memory is too small"
        log.warning("can't open %s: %s", path, sentence)
        _tell(app, path, sentence)
    except Exception as error:  # Warp's and OpenGL's, as when a device's memory is too small
        log.exception("can't open %s", path)
        _tell(app, path, logs.sentence(error), app.log_file)
    else:
        app.log("opened", path=path)
        app.preferences.opened(path)
        problem = app.preferences.save()
        if problem:
            app.recorder.say(problem)


def show_model(app, field, source: Path | None) -> None:
    """Show another model, of that file; nothing changes if it is the one that is shown."""
    if field is app.scene.field:
        return
    on = app.loaded_on or (str(app.scene.solver.device), "auto")
    app.load(field, app.scene.name if source is None else source.stem, *on)
    app.scene.source = source


def needs_training(path: Path) -> bool:
    """Whether these are photographs, or a video, whose cameras no file has."""
    if capture.is_video(path):
        return True
    return path.is_dir() and not has_cameras(path) and photo_folder(path) is not None


def open_photographs(app, folder: Path, outside=False) -> None:
    """Take the photographs of the scene's data set from its folder.

    Args:
        outside: Also those that lie outside the folder.

    Raises:
        DatasetError: The folder is no data set, or has no photograph.
    """
    from ..camera import Photographs

    app.photographs = Photographs(folder, app.scene.field.world_to_model, outside)
    for sentence in app.photographs.said:
        log.warning(printable(sentence))
    app.scene.settings.show_box = True
    app.recorder.say(f"{len(app.photographs)} photographs: [ and ] jump to their cameras")


def _tell(app, path, sentence, log_file=None):
    app.log("problem", path=path, sentence=sentence)
    app.dialog = Problem(f"Can't open {path.name}", sentence, log_file)
