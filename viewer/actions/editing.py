"""Actions on the object: undo, pins, drags, selection, deleting, time."""

from functools import partial

from ..settings import GIZMOS, OF_BONES
from ..tools import KINDS, MOVE, SCALE, TURN, said
from .action import action, choice, gesture, has, method, toggle

gesture("left drag on a red point", "bend the object; all that is selected goes along")
gesture("left drag on the object", "bend it there (Alt: orbit)")
gesture("left drag elsewhere", "orbit; with another tool, push, paint, select or delete")
gesture("click on a red point", "select it; elsewhere, nothing")
gesture("Shift+click on a red point", "select it too, or no longer")
gesture("Ctrl+click on a red point", "select it no longer")
gesture("double click on the object", "a new red point there")
gesture("click on a gray pin", "free it")
gesture("wheel while dragging", "take more or less along")
gesture("click on a violet point", "let it go; a drag has left it there")


@action("undo", "CTRL+Z", "Edit/Undo")
def undo(controls, say):
    label = controls.undo()
    say(f"undone: {label}" if label else "nothing to undo")


@action("redo", "CTRL+SHIFT+Z", "Edit/Redo")
def redo(controls, say):
    label = controls.redo()
    say(f"done again: {label}" if label else "nothing to do again")


method("controls.pin", "pin what is held, selected or under the mouse", "P", "Edit/-Pin")


@action(
    "what a drag lets go stays there, as a violet point; or it springs back",
    *("N", "Edit/Stays when let go"),
    on=has("hand", "pose"),
)
def pose(handles, settings):
    handles.choose_hand("physics" if settings.hand == "pose" else "pose")


@action("it returns to this shape from now on", "T", "Edit/Make this its shape")
def rest_here(body, say):
    if not body.rest_here():
        say("a tangled pose can't be the one to return to")


_help = "it returns to the shape that it had before"
method("body.undo_rest_here", _help, "CTRL+T", "Edit/Shape before")
_help = "back to its shape at rest, with its pins"
method("controls.reset", _help, "R", "Edit/Original shape", "ALT+G")


# -- drags -------------------------------------------------------------------------------------


def _turn_into(kind, controls, fly, gui):
    fly.end()
    if gui is not None and gui.mouse_on_panel:  # a menu: nobody has told the controls
        controls.pointer = gui.pointer * controls.ratio
    controls.turn_into(kind)


for _kind, _help, _key, _menu, _blender in (
    (MOVE, "move what is selected; a click or Enter ends it", "", "-Drag/Move", "G"),
    (TURN, "turn what is selected; in a drag: instead, or move again", "E", "Drag/Turn", "R"),
    (SCALE, "scale what is selected; in a drag: instead, or move again", "S", "Drag/Scale", None),
):
    action(_help, _key, f"Edit/{_menu}", _blender, _kind)(partial(_turn_into, _kind))


def _hold(axis, across, controls):
    """Hold the drag in progress to an axis, or to the plane across it."""
    controls.along(axis, across)


for _axis, _letter in enumerate("xyz"):
    _help = f"along {_letter}" if _axis else "while dragging: along x, its own x, or freely again"
    action(_help, _letter.upper(), name=f"along_{_letter}")(partial(_hold, _axis, False))
    action(f"in the plane across {_letter}", f"SHIFT+{_letter.upper()}", name=f"across_{_letter}")(
        partial(_hold, _axis, True)
    )

gesture("0 to 9, -, .", "while dragging: by how much; Enter or a click: done")


@action(
    "the gizmo moves, turns or scales by its arrows, rings or boxes, or is off",
    *("Q", "Edit/Gizmo/Next"),
)
def next_gizmo(settings, say):
    settings.gizmo = GIZMOS[(GIZMOS.index(settings.gizmo) + 1) % len(GIZMOS)]
    say(f"gizmo: {settings.gizmo}")


for _kind in KINDS:
    choice(
        *("gizmo", _kind, f"it {_kind}s what is selected"),
        menu=f"Edit/Gizmo/{_kind.capitalize()}",
        name=f"gizmo_{_kind}",
    )
choice("gizmo", "off", "nothing but the mouse", menu="Edit/Gizmo/Off", name="gizmo_off")
toggle(
    "own_axes",
    "along the axes that the object has there now, or the bone's; while dragging: X, Y or Z twice",
    *("SHIFT+Q", "Edit/Gizmo/-Its own axes"),
    name="own_axes",
)

# -- tools -------------------------------------------------------------------------------------


def tool(tool, help, key="", menu="", blender=None, name="", stop=""):
    """Make the action that takes a tool into the hand, or puts it away.

    The panel goes along: it shows bones with a tool of bones, and not with another one.
    """

    def take(controls, settings):
        controls.take_tool("grab" if controls.tool.name == tool else tool)
        if settings.tool in OF_BONES and settings.task != "animate":
            settings.task = "rig"
        elif settings.tool not in OF_BONES and settings.task == "rig":
            settings.task = "bend"

    name = name or tool.replace(" ", "_")
    action(help, key, menu, blender, name, has("tool", tool), stop)(take)


tool("grab", "bend: drag red points, or the object", menu="Edit/-Tool/Bend")
tool("push", "push with a ball: left drag", "U", "Edit/Tool/Push with a ball", name="toggle_push")
tool("stiffen", "make stiffer what the mouse passes", menu="Edit/Tool/Stiffen")
tool("soften", "make softer what the mouse passes", menu="Edit/Tool/Soften")


_help = "equally stiff everywhere: forget what was painted"
method("body.clear_paint", _help, "CTRL+E", "Edit/Even stiffness")


tool("delete", "delete with a brush (Shift: all through)", "D", "Edit/Delete/Erase")
tool("delete box", "delete in a box (Ctrl: around it)", "SHIFT+D", "Edit/Delete/Cut box")
tool("delete lasso", "delete in a lasso", "CTRL+SHIFT+D", "Edit/Delete/Cut lasso")
tool("isolate", "isolate one thing: a click, strokes, Enter", menu="Edit/Delete/Isolate")


@action("delete parts with less than 1 % of the matter", menu="Edit/Delete/-Delete specks")
def delete_specks(cuts, controls, say):
    controls.cancel()
    say(said(cuts, cuts.delete_specks))


# -- selection ---------------------------------------------------------------------------------

tool(
    *("box", "select in a box: left drag (Shift adds, Ctrl removes, both intersect)", "B"),
    "Select/Select in a box",
)
tool("lasso", "select in a lasso", "L", "Select/Select in a lasso")


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


method("handles.unhide", "show hidden points", *("CTRL+SHIFT+H", "Select/Show all points", "ALT+H"))


# -- time --------------------------------------------------------------------------------------


@action("pause, or go on", "SPACE", "Edit/-Pause", on="clock.paused", stop="Go on")
def pause(clock):
    clock.paused = not clock.paused


method("clock.single_step", "one 60th of a second; it pauses", "PERIOD", "Edit/Single step")
gesture("right click", "while dragging: let go, it goes back")


@action("likewise; close lists and help", "ESCAPE")
def cancel(settings, controls):
    settings.show_help = False
    controls.escape()
