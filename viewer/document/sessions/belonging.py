"""The model that a session begins with: the one at hand, or the file that the session names.

A session names the file of its model, relative to its own folder, and what has to be the same in
it: the mesh, the stiffnesses and the rig (SHA-256).  So a session opens together with a copy that
was saved on its way: the copy has the rig that the session's edits make, and the session begins
with the model before them.  Without that model's file, a copy of the same mesh is taken, without
the stiffnesses or the rig that the session begins without.
"""

from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from ....core.base.paths import BUNDLED, PROJECT
from ....core.base.reading import check_file
from ....core.base.streams import shown
from .project import load_model
from .session import (
    Session,
    SessionError,
    fits,
    load_session,
    mesh_hash,
    read_header,
    start_in,
)

LONGEST_NAME = 1000  # characters of a path in a session
ENDINGS = ".npz", PROJECT


@dataclass(frozen=True)
class Opened:
    """A session, and the model that it begins with."""

    session: Session
    field: object  # a TetField
    source: Path | None  # the model's file, if it has one
    said: str = ""  # why another model is shown than the one at hand; empty if it isn't


def open_session(path: Path, field, source: Path | None, whole: bool = True) -> Opened:
    """Read a session, and find the model that it begins with.

    Args:
        field, source: The model at hand and its file, None without one.
        whole: As for load_session.

    Raises:
        SessionError: The file is no session, is damaged, or its model is not to be found.
        OSError: It can't be read.
    """
    path = Path(path)
    header = read_header(path)
    found, at, said = field, source, ""
    if not fits(field, header):
        found, at = _named_model(path, header, source)
        if found is not None:
            said = f"{path.name} began with {at.name}, which is shown"
        elif fits(_plain(field, header), header):
            found, at = _plain(field, header), source
            said = f"{path.name} began before the model had this rig or stiffness"
            said += ": the model is shown without"
        else:
            raise SessionError(_missing(path, header, field, source))
    return Opened(load_session(path, found, whole), found, at, said)


def _plain(field, header):
    """The model without the stiffnesses or the rig that the session begins without."""
    start, names = start_in(header), {"stiffness": "stiffness", "rig": "rig_arrays"}
    return replace(field, **{own: None for n, own in names.items() if start.get(n, "") is None})


def _named_model(path, header, source):
    """The model of a file that a session names, and the file; None and None without one."""
    for place in _places(path, header, source):
        try:
            check_file(place)
            field = load_model(place)
        except (OSError, ValueError):  # it is not there, or is no model any more
            continue
        if fits(field, header):
            return field, place
    return None, None


def _places(path, header, source):
    """Where the file that a session names may be: as it says, beside it, or beside the model."""
    name, folder = named_file(header), path.parent
    if name is not None:
        folders = [folder, *([] if source is None else [Path(source).parent])]
        places = [folder / name, *(one / PurePosixPath(name).name for one in folders)]
        yield from dict.fromkeys(places)
    if name is None:
        yield from (path for model, path in BUNDLED.items() if model == header.get("model"))


def named_file(header) -> str | None:
    """The file that a session names, relative to its folder; None if it names none."""
    name = header.get("file")
    if not isinstance(name, str) or not 0 < len(name) <= LONGEST_NAME or not name.isprintable():
        return None
    relative = not PurePosixPath(name).is_absolute() and not {"\\", ":"} & set(name)
    return name if relative and name.endswith(ENDINGS) else None


def _missing(path, header, field, source):
    """Which model a session wants, in a sentence."""
    name, rest = named_file(header), header.get("rest")
    wanted = f"the model {shown(header.get('model'))}"
    if name is not None:
        wanted = f"{name}, which is not there any more, or has another mesh or rig by now"
    at_hand = "the model at hand" if source is None else Path(source).name
    why = f"has {field.mesh.tet_count} tets, not {shown(header.get('tets'))}"
    if rest == mesh_hash(field.mesh):
        why = "has the same mesh, but another rig or other stiffnesses"
    elif header.get("tets") == field.mesh.tet_count:
        why = "has another mesh"
    return (
        f"{path} is a session of another model than {at_hand}, which {why}; it began with {wanted}"
    )
