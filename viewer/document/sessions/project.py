"""Projects: the model, the session and how they are shown, in one file that can be moved.

NAME.deformrf is a zip (docs/project-format.md):

    project.json    its version, the model's name and hash, settings, the camera
    session.jsonl   what was done, as `save_session` writes it
    model.npz       the model as the session begins with it; none if it is a bundled one

Nothing in a file is trusted: sizes, names, kinds and ranges are checked.  Entries are read into
memory, and nothing is written where a project says.
"""

import hashlib
import io
import json
import logging
import zipfile
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from ....core import field as fields
from ....core.base.archive import MAX_BYTES, Archive, one_sentence, open_archive, unpacked_limit
from ....core.base.paths import BUNDLED, PROJECT, is_project, program_version, whole_file
from ....core.base.reading import read_bytes
from ....core.base.schema import FileError, check, flag, mapping, one_of
from ....core.base.streams import shown
from ....core.field import TetField
from ...camera import Orbit, changed, values_of
from ...settings import Settings, kept_in
from .session import (
    LARGEST_FILE,
    OpenObject,
    Session,
    SessionError,
    fits,
    header_of,
    name_of_model,
    session_of,
    session_text,
    tell_left_out,
)
from .session_values import camera

KEY, VERSION = "deformrf project", 1
ABOUT, SESSION, MODEL = "project.json", "session.jsonl", "model.npz"
LARGEST_ABOUT = 2**20  # bytes
PERMISSIONS = 0o644 << 16  # of what `unzip` makes of an entry
LOOKS = kept_in("session") | kept_in("project")  # whether a value of the file is one
is_orbit = mapping(camera)
log = logging.getLogger(__name__)


class ProjectError(ValueError):
    """A file is no project, or is damaged; the message is one sentence."""


class ShownObject(OpenObject, Protocol):
    """The object that is open, and how it is shown."""

    settings: Settings
    orbit: Orbit

    def note_view(self) -> None: ...


@dataclass(frozen=True)
class Project:
    """A project that was read."""

    path: Path
    session: Session
    field: TetField  # that the session begins with
    source: Path  # the file that has it: the project's own, or a bundled model's
    looks: dict[str, Any]  # Settings by name
    orbit: dict[str, Any] | None  # the camera's values
    said: str = ""  # what is not as it was

    def apply_looks(self, viewed: ShownObject) -> None:
        """Show an object as the project does."""
        for name, value in self.looks.items():
            setattr(viewed.settings, name, tuple(value) if isinstance(value, list) else value)
        if self.orbit is not None:
            viewed.orbit = changed(viewed.orbit, self.orbit)


# -- writing -----------------------------------------------------------------------------------


def save_project(
    viewed: ShownObject, start: dict, path: Path, tell: Callable = log.warning
) -> Path:
    """Write a project of an object that had this `start`; its model is in that file then.

    What no reader would take of the session is left out: `tell` gets a sentence then.

    Raises:
        ProjectError: Its name has another ending.
        SessionError: The session is longer than those that can be read.
        OSError: The file can't be written; one that was there before stays.
    """
    path = Path(path).absolute()
    if not is_project(path):
        raise ProjectError(f"{path} is no name of a project: it has to end in {PROJECT}")
    viewed.note_view()
    bundled = next((name for name, file in BUNDLED.items() if file == viewed.source), None)
    model = _model_of(viewed) if bundled is None else read_bytes(viewed.source, MAX_BYTES)
    text, left_out = session_text(viewed, start, MODEL if bundled is None else None)
    looks = {name: getattr(viewed.settings, name) for name in LOOKS}
    orbit = values_of(viewed.orbit)
    own = viewed.source is None or is_project(viewed.source)
    about = {
        KEY: VERSION,
        "program": program_version(),
        "model": bundled or viewed.name,
        "file": None if own else name_of_model(viewed.source, path),
        "sha256": _hash_of(model),
        "bundled": bundled is not None,
        "looks": {name: value for name, value in looks.items() if LOOKS[name](value)},
        "orbit": orbit if is_orbit(orbit) else None,
    }
    entries = {ABOUT: json.dumps(about, indent=1).encode(), SESSION: text.encode()}
    _write(entries | ({MODEL: model} if bundled is None else {}), path)
    viewed.source = path if bundled is None else viewed.source
    tell_left_out(left_out, tell)
    return path


def _model_of(viewed: ShownObject):
    """The bytes of the model's file, if it still is what was opened; else those of a copy."""
    source = viewed.source
    try:
        if source is not None:
            content = _content_of(source)
            if fields.same_values(fields.load(source, content), viewed.field):
                return content
    except (OSError, ValueError):
        pass  # it is gone, or no model any more
    with TemporaryDirectory(prefix="deformrf-", ignore_cleanup_errors=True) as folder:
        return read_bytes(fields.save_exactly(viewed.field, Path(folder) / MODEL), MAX_BYTES)


def _write(entries, path):
    """Write a zip: JSON is deflated, unless the reader would then take it for a bomb."""
    with whole_file(path) as partial:
        for kind in (zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED):
            with zipfile.ZipFile(partial, "w") as made:
                for name, content in entries.items():
                    entry = zipfile.ZipInfo(name)
                    entry.external_attr = PERMISSIONS
                    made.writestr(entry, content, zipfile.ZIP_STORED if name == MODEL else kind)
            if sum(map(len, entries.values())) <= unpacked_limit(partial.stat().st_size):
                return


# -- reading -----------------------------------------------------------------------------------


def load_project(path: str | Path) -> Project:
    """Read and check a project.

    Raises:
        ProjectError: The file is missing, no project, of another version, or damaged.
    """
    path = Path(path)
    with _opened(path) as archive:
        about = _about_of(archive)
        field, source, said = _begun_with(archive, path, about)
        lines = io.BytesIO(archive.read(SESSION, LARGEST_FILE))
        whose = f"the model {about['model']} of this program" if about["bundled"] else "its model"
        fitting = fits(field, header_of(lines, path))
        check(fitting, f"{whose} is not the one that its session began with")
        lines.seek(0)
        session = session_of(lines, path, field)
    looks, orbit = about.get("looks"), about.get("orbit")
    values = looks if isinstance(looks, dict) else {}
    looks = {name: values[name] for name in LOOKS if name in values and LOOKS[name](values[name])}
    orbit = orbit if is_orbit(orbit) else None
    return Project(path.absolute(), session, field, source, looks, orbit, said)


def load_model(path: Path) -> TetField:
    """Read a model file, or the model in a project.

    Raises:
        ValueError or OSError: There is none.
    """
    return fields.load(path, _content_of(path))


@contextmanager
def _opened(path):
    """The archive of a project, while it is open; any error in the block is a ProjectError."""
    foreseen = FileError, SessionError
    with one_sentence(path, foreseen, ProjectError), open_archive(path, "project") as archive:
        yield archive


def _about_of(archive: Archive) -> dict:
    """The values of project.json, as far as they tell how to read the rest."""
    check(ABOUT in archive.names, f"it is not a project, or is damaged: it has no '{ABOUT}'")
    about = json.loads(archive.read(ABOUT, LARGEST_ABOUT))
    named = isinstance(about, dict) and KEY in about
    check(named, f"it is not a project: its '{ABOUT}' doesn't say so")
    version = shown(about[KEY])
    check(about[KEY] == VERSION, f"it has version {version}; this program reads {VERSION}")
    check(flag(about.get("bundled")), f"its '{ABOUT}' doesn't say where its model is")
    if about["bundled"]:
        known = one_of(BUNDLED)(about.get("model"))
        check(known, f"this program has no model {shown(about.get('model'))}, which it is of")
    return about


def _begun_with(archive, path, about):
    """The model that the session begins with, the file that has it, and a sentence."""
    if about["bundled"]:
        name = about["model"]
        same = _hash_of(read_bytes(BUNDLED[name], MAX_BYTES)) == about.get("sha256")
        said = f"{path.name} was made with another version of the model {name}"
        return fields.load(BUNDLED[name]), BUNDLED[name], "" if same else said
    content = _model_in(archive)
    same = _hash_of(content) == about.get("sha256")
    check(same, "its model is damaged, or is not the one that was saved")
    return fields.load(path, content), path.absolute(), ""


def _content_of(path):
    """The bytes of a model file, or of the model in a project."""
    if not is_project(path):
        return read_bytes(path, MAX_BYTES)
    with _opened(path) as archive:
        return _model_in(archive)


def _model_in(archive):
    """The bytes of the model; stored as they are, they can't be a bomb in a bomb."""
    entry = archive.names.get(MODEL)
    check(entry is None or entry.compress_type == zipfile.ZIP_STORED, "its model is compressed")
    return archive.read(MODEL, MAX_BYTES)


def _hash_of(content):
    return hashlib.sha256(content).hexdigest()
