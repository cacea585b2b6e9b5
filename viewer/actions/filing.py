"""Actions on files: what is opened, saved and exported."""

from ...wings.rig import arrays_of
from ..files import surface_of
from .action import action, toggle


@action("begin anew with this model; what you did is kept", "CTRL+N", "File/New")
def new(playing):
    playing.begin_anew()


@action("open a project, a model or a session", "CTRL+O", "File/Open...")
def open(opening):
    opening.ask()


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
    "write the model as it is: its stiffness and rig, without what was deleted",
    menu="File/Export/Model",
)
def save_model(body, cuts, field, rigging, recorder):
    factors = None if body.factors is None else body.factors.copy()
    arrays = field.rig_arrays
    if rigging.changed:  # else a session fits the copy as well: the arrays are the same
        rig = rigging.rig
        arrays = None if rig is None else arrays_of(rig)
    recorder.save_model(cuts.smaller(factors, arrays))


@action("write what was done as a session", menu="File/Export/Session")
def save_session(save_session):
    save_session()


@action("a picture of the view", "F2", "File/Export/Picture")
def screenshot(recorder):
    recorder.screenshot()


toggle(
    "transparent_screenshots",
    "pictures are of the field alone, with its opacity",
    menu="File/Export/Transparent pictures",
    name="toggle_transparent",
)


def _export(ending):
    """Make the action that writes the surface of the mesh in its pose."""

    def export(cuts, solver, radiance, field, recorder):
        try:
            surface = surface_of(cuts.tets, cuts.neighbours, solver.vertices.numpy())
        except ValueError as error:
            recorder.say(str(error))
        else:
            recorder.save_surface(radiance.colored(surface), ending, field.attribution)

    kind = ending.removeprefix(".")
    menu = f"File/Export/Mesh as {kind.upper()}"
    action("the mesh in this pose", menu=menu, name=f"export_{kind}")(export)


_export(".ply")
_export(".obj")


@action("quit", "CTRL+Q", "File/-Quit")
def quit(questions):
    questions.leave()
