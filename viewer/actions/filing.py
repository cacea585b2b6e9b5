"""Actions on files: what is opened, saved and exported."""

from functools import partial

from ...wings.rig import arrays_of
from ..files import surface_of
from .action import action, method

_help = "begin anew with this model; what you did is kept"
method("playing.begin_anew", _help, "CTRL+N", "File/New", name="new")
_help = "open a project, a model or a session"
method("opening.ask", _help, "CTRL+O", "File/Open...", name="open")


@action("save the project: all that was done, with the model", "CTRL+S", "File/-Save")
def save(opening, project, save_project):
    if project is None:
        opening.ask_where(save_project)
    else:
        save_project()


@action("save the project under another name", "CTRL+SHIFT+S", "File/Save as...")
def save_as(opening, save_project):
    opening.ask_where(save_project)


@action(
    "write the model with its stiffness, bones, weights and clips, without what was deleted",
    menu="File/Export/Model",
)
def save_model(body, cuts, field, rigging, recorder):
    factors = None if body.factors is None else body.factors.copy()
    arrays = field.rig_arrays
    if rigging.changed:  # else a session fits the copy as well: the arrays are the same
        rig = rigging.rig
        arrays = None if rig is None else arrays_of(rig)
    recorder.save_model(cuts.smaller(factors, arrays))


_help = "write what was done as a session, of which deformrf render makes a film"
method("save_session", _help, menu="File/Export/Session")


def _export(ending, cuts, solver, radiance, field, recorder):
    """Write the surface of the mesh in its pose."""
    try:
        surface = surface_of(cuts.tets, cuts.neighbours, solver.vertices.numpy())
    except ValueError as error:
        recorder.say(str(error))
    else:
        recorder.save_surface(radiance.colored(surface), ending, field.attribution)


for _kind in ("ply", "obj"):
    action(
        *("the mesh in this pose", "", f"File/Export/Mesh as {_kind.upper()}"),
        name=f"export_{_kind}",
    )(partial(_export, f".{_kind}"))


method("questions.leave", "quit", "CTRL+Q", "File/-Quit", name="quit")
