"""Actions on the object: undo, pins, drags, selection, deleting, time."""

from functools import partial

from ..settings import GIZMOS
from ..tools import KINDS, MOVE, SCALE, TURN, said
from .action import action, choice, gesture, toggle

gesture("left drag on a red point", "bend the object; all that is selected goes along")
gesture("left drag on the object", "bend it there (Alt: orbit)")
gesture("left drag elsewhere", "orbit; with another tool, push, paint, select or delete")
gesture("click on a red point", "select it; elsewhere, nothing")
gesture("Shift+click on a red point", "select it too, or no longer")
gesture("Ctrl+click on a red point", "select it no longer")
gesture("double click on the object", "a new red point there")
gesture("click on a gray pin", "free it")
gesture("wheel while dragging", "take more or less along")
gesture("click on a golden point", "let it go: it was left there in Pose")


@action("undo", "CTRL+Z", "Edit/Undo")
def undo(controls, say):
    label = controls.undo()
    say(f"undone: {label}" if label else "nothing to undo")


@action("redo", "CTRL+SHIFT+Z", "Edit/Redo")
def redo(controls, say):
    label = controls.redo()
    say(f"done again: {label}" if label else "nothing to do again")


@action("pin what is held, selected or under the mouse", "P", "Edit/-Pin")
def pin(controls):
    controls.pin()


@action(
    "Pose: what is let go stays; or Physics: it swings back",
    "N",
    "Edit/Pose",
    on=lambda settings: settings.hand == "pose",
)
def pose(handles, settings):
    handles.choose_hand("physics" if settings.hand == "pose" else "pose")


@action("rest here: return to this pose from now on", "T", "Edit/Rest here")
def rest_here(body, say):
    if not body.rest_here():
        say("a tangled pose can't be the one to return to")


@action("return to the shape before", "CTRL+T", "Edit/Return to the shape before")
def undo_rest_here(body):
    body.undo_rest_here()


@action("reset the deformation; pins come back", "R", "Edit/Reset", "ALT+G")
def reset(controls):
    controls.reset()


# -- drags -------------------------------------------------------------------------------------


def _turn_into(kind, controls, fly, gui):
    fly.end()
    if gui is not None and gui.mouse_on_panel:  # a menu: nobody has told the controls
        controls.pointer = gui.pointer * controls.ratio
    controls.turn_into(kind)


def _begin(kind, help, key, menu, blender=None):
    """Make the action that moves, turns or scales what is held or chosen."""
    action(help, key, menu, blender, kind)(partial(_turn_into, kind))


_begin(MOVE, "move what is selected; a click or Enter ends it", "", "Edit/-Drag/Move", "G")
_begin(TURN, "turn it; while dragging: instead, or move again", "E", "Edit/Drag/Turn", "R")
_begin(SCALE, "scale, likewise", "S", "Edit/Drag/Scale")


def _hold(axis):
    """Make the actions that hold the drag in progress to an axis, and to the plane across it."""
    name = "xyz"[axis]
    along = (
        "while dragging: along x, along its own x, or freely again"
        if axis == 0
        else (f"along {name}")
    )
    action(along, name.upper(), name=f"along_{name}")(lambda controls: controls.along(axis))
    across = f"in the plane across {name}"
    action(across, f"SHIFT+{name.upper()}", name=f"across_{name}")(
        lambda controls: controls.along(axis, True)
    )


for _axis in range(3):
    _hold(_axis)

gesture("0 to 9, -, .", "while dragging: by how much; Enter or a click: done")


@action("the gizmo moves, turns, scales, or is off", "Q", "Edit/Gizmo/Next")
def next_gizmo(settings, say):
    settings.gizmo = GIZMOS[(GIZMOS.index(settings.gizmo) + 1) % len(GIZMOS)]
    say(f"gizmo: {settings.gizmo}")


for _kind in KINDS:
    _title = _kind.capitalize()
    choice(
        *("gizmo", _kind, f"it {_kind}s what is selected"),
        menu=f"Edit/Gizmo/{_title}",
        name=f"gizmo_{_kind}",
    )
choice("gizmo", "off", "nothing but the mouse", menu="Edit/Gizmo/Off", name="gizmo_off")
toggle(
    *("own_axes", "along the selection's own axes", "SHIFT+Q", "Edit/Gizmo/-Own axes"),
    name="own_axes",
)

# -- tools -------------------------------------------------------------------------------------


def tool(tool, help, key="", menu="", blender=None, name=""):
    """Make the action that takes a tool into the hand, or puts it away."""

    def take(controls):
        controls.take_tool("grab" if controls.tool.name == tool else tool)

    def is_on(settings):
        return settings.tool == tool

    action(help, key, menu, blender, name or tool.replace(" ", "_"), is_on)(take)


tool("grab", "bend: drag red points, or the object", menu="Edit/-Tool/Bend")
tool("push", "push with a ball: left drag", "U", "Edit/Tool/Push with a ball", name="toggle_push")
tool("stiffen", "make stiffer what the mouse passes", menu="Edit/Tool/Stiffen")
tool("soften", "make softer what the mouse passes", menu="Edit/Tool/Soften")


@action("equally stiff everywhere: forget what was painted", "CTRL+E", "Edit/Even stiffness")
def clear_paint(body):
    body.clear_paint()


tool("delete", "delete with a brush (Shift: all through)", "D", "Edit/Delete/Brush")
tool("delete box", "in a box (Ctrl: around it)", "SHIFT+D", "Edit/Delete/Box")
tool("delete lasso", "in a lasso", "CTRL+SHIFT+D", "Edit/Delete/Lasso")


@action("parts with less than 1 % of the matter", menu="Edit/Delete/-Specks")
def delete_specks(cuts, controls, say):
    controls.cancel()
    say(said(cuts, cuts.delete_specks))


# -- selection ---------------------------------------------------------------------------------

tool(
    "box",
    "select in a box: left drag (Shift adds, Ctrl removes, both intersect)",
    "B",
    "Select/In a box",
)
tool("lasso", "select in a lasso", "L", "Select/In a lasso")


@action("select all red points in sight", "CTRL+A", "Select/-All", "A")
def select_all(handles, controls):
    ids = handles.control_ids
    handles.select(ids[controls.shown(ids)])


@action("select no point", menu="Select/None", blender="ALT+A")
def select_none(handles):
    handles.select([])


@action("hide the selected points", "CTRL+H", "Select/-Hide points", "H")
def hide(handles, say):
    if not handles.hide():
        say("nothing to hide: select red points first")


@action("show hidden points", "CTRL+SHIFT+H", "Select/Show all points", "ALT+H")
def unhide(handles):
    handles.unhide()


# -- time --------------------------------------------------------------------------------------


@action("pause, or go on", "SPACE", "Edit/-Pause", on=lambda clock: clock.paused)
def pause(clock):
    clock.paused = not clock.paused


@action("single step", "PERIOD", "Edit/Single step")
def single_step(clock):
    clock.single_step()


gesture("right click", "while dragging: let go, it goes back")


@action("likewise; close lists and help", "ESCAPE")
def cancel(settings, controls):
    settings.show_help = False
    controls.escape()
