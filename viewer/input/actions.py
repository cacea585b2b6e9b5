"""User actions: the table of gestures and keys, and the functions that keys and menus call.

INPUTS is the only list: key bindings, menus, tooltips, hints, the help overlay and
docs/keys.md follow it.
"""

from dataclasses import dataclass
from operator import attrgetter

from ...core.render import MODES
from ..files import ask_for_file, surface_of
from ..settings import DELETING, OF_BONES, PANEL_WIDTHS, SIDES
from .delete_actions import DELETE_ACTIONS
from .drags import SCALE, TURN
from .rig_actions import RIG_ACTIONS
from .timeline_actions import TIMELINE_ACTIONS
from .view_actions import VIEW_ACTIONS


@dataclass(frozen=True)
class Input:
    """A gesture, key or item of a menu, and its action."""

    label: str  # the key or gesture, as the help names it; empty for what only a menu has
    help: str  # what it does
    key: str = ""  # pyglet's name of the key, with CTRL+ and SHIFT+ before it if they are held
    action: str = ""  # what key and menu call, one of ACTIONS
    menu: str = ""  # where it is in the menus, as in "Edit/Undo" or "File/Export/Mesh as OBJ"


INPUTS = (
    Input("left drag on a red point", "bend the object; all that is selected goes along"),
    Input("left drag on the object", "bend it there (Alt: orbit)"),
    Input("left drag elsewhere", "orbit; with another tool, push, paint, select or delete"),
    Input("click on a red point", "select it; elsewhere, nothing"),
    Input("Shift+click on a red point", "select it too, or no longer"),
    Input("Ctrl+click on a red point", "select it no longer"),
    Input("double click on the object", "a new red point there"),
    Input("click on a gray pin", "free it"),
    Input("wheel while dragging", "take more or less along"),
    Input("click on a golden point", "let it go: it was left there in Pose"),
    Input("P", "pin what is held, selected or under the mouse", "P", "pin", "Edit/Pin"),
    Input("X", "while dragging: along x only, or freely again", "X", "along_x"),
    Input("Y", "along y only", "Y", "along_y"),
    Input("Z", "along z only", "Z", "along_z"),
    Input("E", "while dragging: turn instead; a bone, or reach with its tip again", "E", "turn"),
    Input("S", "while dragging: scale instead", "S", "scale"),
    Input(
        "B",
        "select in a box: left drag (Shift adds, Ctrl removes, both intersect)",
        "B",
        "box",
        "Edit/Select in a box",
    ),
    Input("L", "select in a lasso", "L", "lasso", "Edit/Select in a lasso"),
    Input("Ctrl+A", "select all red points in sight", "CTRL+A", "select_all", "Edit/Select all"),
    Input("Ctrl+H", "hide the selected points", "CTRL+H", "hide", "Edit/Hide points"),
    Input("Ctrl+Shift+H", "show hidden points", "CTRL+SHIFT+H", "unhide", "Edit/Show all points"),
    Input("U", "push with a ball instead: left drag", "U", "toggle_push", "Edit/Push with a ball"),
    Input(
        "Ctrl+E",
        "equally stiff everywhere: forget what was painted",
        "CTRL+E",
        "clear_paint",
        "Edit/Even stiffness",
    ),
    Input("Ctrl+O", "open a model or a session", "CTRL+O", "open", "File/Open..."),
    Input(
        "Ctrl+S",
        "write the model as it is: its stiffness and rig, without what was deleted",
        "CTRL+S",
        "save_model",
        "File/Save model copy",
    ),
    Input("Ctrl+Z", "undo", "CTRL+Z", "undo", "Edit/Undo"),
    Input("Ctrl+Shift+Z", "redo", "CTRL+SHIFT+Z", "redo", "Edit/Redo"),
    Input("Ctrl+Shift+S", "save the session", "CTRL+SHIFT+S", "save_session", "File/Save session"),
    Input("T", "rest here: return to this pose from now on", "T", "rest_here", "Edit/Rest here"),
    Input(
        "Ctrl+T",
        "return to the shape before",
        "CTRL+T",
        "undo_rest_here",
        "Edit/Return to the shape before",
    ),
    Input("D", "delete with a brush (Shift: all through)", "D", "delete", "Edit/Delete/Brush"),
    Input("Shift+D", "in a box (Ctrl: around it)", "SHIFT+D", "delete_box", "Edit/Delete/Box"),
    Input("Ctrl+Shift+D", "in a lasso", "CTRL+SHIFT+D", "delete_lasso", "Edit/Delete/Lasso"),
    Input("", "parts with less than 1 % of the matter", "", "delete_specks", "Edit/Delete/Specks"),
    Input("middle or right drag", "pan"),
    Input("wheel", "zoom to the mouse; with the brush that deletes, its size"),
    Input("F", "focus: the object, or the point under the mouse", "F", "focus", "View/Focus"),
    Input("Home", "reset the camera", "HOME", "home", "View/Reset camera"),
    Input("1", "look from the front", "_1", "front", "View/From/Front"),
    Input("3", "look from the right", "_3", "right", "View/From/Right"),
    Input("7", "look from above", "_7", "above", "View/From/Above"),
    Input("Shift+1", "look from the back", "SHIFT+_1", "back", "View/From/Back"),
    Input("Shift+3", "look from the left", "SHIFT+_3", "left", "View/From/Left"),
    Input("Shift+7", "look from below", "SHIFT+_7", "below", "View/From/Below"),
    Input("5", "orthographic, or not", "_5", "toggle_parallel", "View/Orthographic"),
    Input("G", "go: fly with W A S D, Q and E, and the mouse; Esc ends", "G", "fly", "View/Fly"),
    Input(
        "]",
        "next photograph, from its camera",
        "BRACKETRIGHT",
        "next_photograph",
        "View/Photograph/Next",
    ),
    Input("[", "photograph before", "BRACKETLEFT", "previous_photograph", "View/Photograph/Before"),
    Input(
        "\\",
        "photograph over the render, beside it, or hidden",
        "BACKSLASH",
        "place_photograph",
        "View/Photograph/Over, beside or hidden",
    ),
    Input("V", "next saved view", "V", "next_view", "View/Next saved view"),
    Input("Shift+V", "save this view", "SHIFT+V", "save_view", "View/Save view"),
    Input("R", "reset the deformation; pins come back", "R", "reset", "Edit/Reset"),
    Input("Space", "pause, or go on", "SPACE", "pause", "Edit/Pause"),
    Input(".", "single step", "PERIOD", "single_step", "Edit/Single step"),
    Input("N", "Pose: what is let go stays; or Physics: it swings back", "N", "pose", "Edit/Pose"),
    Input("M", "next view mode: depth, normals, ...", "M", "next_mode", "View/Next mode"),
    Input("H", "hide or show all points and pins", "H", "toggle_handles", "View/Vertices"),
    Input("W", "wireframe", "W", "toggle_wireframe", "View/Wireframe"),
    Input("O", "the box that training found around the object", "O", "toggle_box", "View/Box"),
    Input("Tab", "hide or show the panel", "TAB", "toggle_panel", "View/Panel/Shown"),
    Input("", "at the other side", action="panel_side", menu="View/Panel/On the right"),
    Input("", "40 points wider", action="panel_wider", menu="View/Panel/Wider"),
    Input("", "40 points narrower", action="panel_narrower", menu="View/Panel/Narrower"),
    *(
        Input(f"Ctrl+{k}", f"show {mode}", f"CTRL+_{k}", f"show_{mode}", f"View/Show/{mode}")
        for k, mode in enumerate(MODES, start=1)
    ),
    Input("Ctrl+9", "strain as colors", "CTRL+_9", "toggle_strain", "View/Mesh/strain"),
    Input("Ctrl+0", "volume ratio as colors", "CTRL+_0", "toggle_volume", "View/Mesh/volume ratio"),
    Input("Ctrl+W", "surface of the mesh", "CTRL+W", "toggle_surface", "View/Mesh/plain"),
    Input("Shift+T", "timeline", "SHIFT+T", "toggle_timeline", "Timeline/Show"),
    Input("K", "key camera and pose at the playhead", "K", "key", "Timeline/Key"),
    Input("Ctrl+K", "key the camera", "CTRL+K", "key_camera", "Timeline/Key the camera"),
    Input("Shift+K", "key the pose", "SHIFT+K", "key_pose", "Timeline/Key the pose"),
    Input("Enter", "play the timeline, or stop", "ENTER", "play", "Timeline/Play"),
    Input("Page Down", "next key", "PAGEDOWN", "next_key", "Timeline/Next key"),
    Input("Page Up", "key before", "PAGEUP", "previous_key", "Timeline/Key before"),
    Input(
        "Delete",
        "delete the chosen key; while joints are placed, the joint",
        "DELETE",
        "delete_key",
        "Timeline/Delete key",
    ),
    Input("Ctrl+D", "copy a key to the playhead", "CTRL+D", "copy_key", "Timeline/Copy key"),
    Input("Shift+O", "turn around the object", "SHIFT+O", "turntable", "Timeline/Turntable"),
    Input("", "save the pose, to blend it", "", "save_pose", "Timeline/Save pose"),
    Input("", "play again and again", "", "toggle_loop", "Timeline/Loop"),
    Input(
        "J",
        "place joints: click on the object; each goes on from the chosen one",
        "J",
        "joints",
        "Rig/Place joints",
    ),
    Input("A", "animate: drag a bone to turn it, its tip to reach", "A", "bones", "Rig/Pose bones"),
    Input("Shift+A", "bones at rest", "SHIFT+A", "rest_bones", "Rig/Bones at rest"),
    Input("Shift+Enter", "play the chosen clip, or stop", "SHIFT+ENTER", "play_clip", "Rig/Play"),
    Input("", "play clips again and again", "", "loop_clip", "Rig/Loop"),
    Input("Shift+C", "a clip of the timeline's poses of bones", "SHIFT+C", "save_clip", "Rig/Clip"),
    Input("Shift+H", "hide or show bones", "SHIFT+H", "toggle_bones", "Rig/Shown"),
    Input("F1", "hide or show the help", "F1", "toggle_help", "Help/Keys and gestures"),
    Input("F2", "screenshot", "F2", "screenshot", "File/Export/Picture"),
    Input(
        "",
        "pictures are of the field alone, with its opacity",
        action="toggle_transparent",
        menu="File/Export/Transparent pictures",
    ),
    Input("", "the mesh in this pose", action="export_ply", menu="File/Export/Mesh as PLY"),
    Input("", "the mesh in this pose", action="export_obj", menu="File/Export/Mesh as OBJ"),
    Input(
        "F9", "start or stop recording, for a film rendered in full", "F9", "record", "File/Record"
    ),
    Input("Ctrl+F9", "a film of what was recorded", "CTRL+F9", "save_film", "File/Save film"),
    Input("Shift+F9", "clip of the screen", "SHIFT+F9", "record_screen", "File/Record screen"),
    Input("Esc", "let go, a vertex goes back; close lists and help", "ESCAPE", "cancel"),
    Input("Ctrl+Q", "quit", "CTRL+Q", "quit", "File/Quit"),
)


def _toggle(name, owner_of=attrgetter("scene.settings")):
    """A function that switches an attribute, one of the Settings by default."""

    def toggle(app):
        owner = owner_of(app)
        setattr(owner, name, not getattr(owner, name))

    toggle.is_on = lambda app: getattr(owner_of(app), name)
    return toggle


def _choose(name, value, otherwise=None):
    """A function that gives one of the Settings a value; or another one, if it has that value."""

    def choose(app):
        settings = app.scene.settings
        has_it = otherwise is not None and getattr(settings, name) == value
        setattr(settings, name, otherwise if has_it else value)

    choose.is_on = lambda app: getattr(app.scene.settings, name) == value
    return choose


def _toggle_handles(app):
    _toggle("show_handles")(app)
    app.scene.handles.hover = None


_toggle_handles.is_on = lambda app: app.scene.settings.show_handles


def _reset(app):
    app.controls.cancel()
    app.scene.reset()


def _pose(app):
    handles = app.scene.handles
    handles.choose_hand("physics" if app.scene.settings.hand == "pose" else "pose")


_pose.is_on = lambda app: app.scene.settings.hand == "pose"


def _next_mode(app):
    settings = app.scene.settings
    settings.mode = MODES[(MODES.index(settings.mode) + 1) % len(MODES)]


def _rest_here(app):
    if not app.scene.body.rest_here():
        app.recorder.say("a tangled pose can't be the one to return to")


def _undo(app):
    journal = app.scene.journal
    count = journal.cursor
    app.controls.cancel()
    if journal.cursor < count:  # a drag's step, which is all that is taken back
        app.recorder.say("undone: drag")
        return
    label = journal.undoes
    app.recorder.say(f"undone: {label}" if app.scene.undo() else "nothing to undo")


def _redo(app):
    app.controls.cancel()
    label = app.scene.journal.redoes
    app.recorder.say(f"done again: {label}" if app.scene.redo() else "nothing to do again")


def _cancel(app):
    app.scene.settings.show_help = False
    if not app.controls.mode and app.scene.settings.tool in OF_BONES:
        app.scene.settings.tool = "grab"
    app.controls.cancel()


def _tool(name):
    """A function that takes a tool into the hand, or puts it away."""

    def take(app):
        settings = app.scene.settings
        settings.tool = "grab" if settings.tool == name else name

    return take


def _select_all(app):
    handles = app.scene.handles
    ids = handles.control_ids
    handles.select(ids[app.controls.shown(ids)])


def _hide(app):
    if not app.scene.handles.hide():
        app.recorder.say("nothing to hide: select red points first")


def _export(ending):
    """A function that writes the surface of the mesh in its pose."""

    def write(app):
        scene = app.scene
        try:
            cuts = scene.cuts
            surface = surface_of(cuts.tets, cuts.neighbours, scene.solver.vertices.numpy())
        except ValueError as error:
            app.recorder.say(str(error))
        else:
            surface, told = app.radiance.colored(surface), scene.field.attribution
            app.recorder.save_surface(surface, ending, told)

    return write


def _panel_side(app):
    settings = app.scene.settings
    settings.panel_side = SIDES[1 - SIDES.index(settings.panel_side)]


_panel_side.is_on = lambda app: app.scene.settings.panel_side == "right"


def _widen_panel(by):
    """A function that makes the panel wider [points]."""

    def widen(app):
        settings, (low, high) = app.scene.settings, PANEL_WIDTHS
        settings.panel_width = min(max(settings.panel_width + by, low), high)

    return widen


ACTIONS = {  # functions of the App; what can be on or off has `is_on`, which menus check
    **VIEW_ACTIONS,
    **DELETE_ACTIONS,
    **TIMELINE_ACTIONS,
    **RIG_ACTIONS,
    "joints": _tool("joints"),
    "bones": _tool("bones"),
    "toggle_bones": _toggle("show_bones"),
    "toggle_timeline": _toggle("show_timeline"),
    "reset": _reset,
    "pause": _toggle("paused", attrgetter("scene")),
    "single_step": lambda app: app.scene.single_step(),
    "pin": lambda app: app.controls.pin(),
    "pose": _pose,
    "along_x": lambda app: app.controls.along(0),
    "along_y": lambda app: app.controls.along(1),
    "along_z": lambda app: app.controls.along(2),
    "turn": lambda app: app.controls.turn_into(TURN),
    "scale": lambda app: app.controls.turn_into(SCALE),
    "box": _tool("box"),
    "lasso": _tool("lasso"),
    "select_all": _select_all,
    "hide": _hide,
    "unhide": lambda app: app.scene.handles.unhide(),
    "toggle_push": _tool("push"),
    **{tool.replace(" ", "_"): _tool(tool) for tool in DELETING},
    "clear_paint": lambda app: app.scene.body.clear_paint(),
    "undo": _undo,
    "redo": _redo,
    "save_session": lambda app: app.save_session(),
    "rest_here": _rest_here,
    "undo_rest_here": lambda app: app.scene.body.undo_rest_here(),
    "next_mode": _next_mode,
    **{f"show_{mode}": _choose("mode", mode) for mode in MODES},
    "toggle_strain": _choose("mesh_surface", "strain", "hidden"),
    "toggle_volume": _choose("mesh_surface", "volume ratio", "hidden"),
    "toggle_surface": _choose("mesh_surface", "plain", "hidden"),
    "toggle_handles": _toggle_handles,
    "toggle_wireframe": _toggle("show_wireframe"),
    "toggle_panel": _toggle("show_panel"),
    "toggle_help": _toggle("show_help"),
    "screenshot": lambda app: app.recorder.screenshot(),
    "record": lambda app: app.takes.start_or_stop(),
    "save_film": lambda app: app.takes.ask(),
    "record_screen": lambda app: app.recorder.start_or_stop(),
    "cancel": _cancel,
    "quit": lambda app: app.quit(),
    "open": ask_for_file,
    "toggle_transparent": _toggle("transparent_screenshots"),
    "export_ply": _export(".ply"),
    "export_obj": _export(".obj"),
    "panel_side": _panel_side,
    "panel_wider": _widen_panel(40.0),
    "panel_narrower": _widen_panel(-40.0),
}
OTHER_NAMES = {  # of digits: the number pad's, X11's for it without Num Lock, US Shift+digit
    **{f"NUM_{n}": f"_{n}" for n in range(10)},
    **{"NUM_END": "_1", "NUM_PAGE_DOWN": "_3", "NUM_NEXT": "_3", "NUM_BEGIN": "_5"},
    **{"NUM_HOME": "_7", "NUM_LEFT": "_4", "NUM_RIGHT": "_6", "NUM_UP": "_8", "NUM_DOWN": "_2"},
    **{"EXCLAMATION": "_1", "POUND": "_3", "HASH": "_3", "AMPERSAND": "_7"},
}
_ACTION_OF = {entry.key: entry.action for entry in INPUTS if entry.key}


def action_of(key: str, ctrl: bool, shift: bool = False) -> str | None:
    """The action of a key, by pyglet's name of it."""
    key = OTHER_NAMES.get(key, key)
    found = _ACTION_OF.get("CTRL+" * ctrl + "SHIFT+" * shift + key)
    return _ACTION_OF.get(key) if found is None and not ctrl else found


def label_of(action: str) -> str:
    """The key that calls an action, as shown to the user."""
    return next(entry.label for entry in INPUTS if entry.action == action)
