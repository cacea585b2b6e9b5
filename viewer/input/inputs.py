"""The table of gestures and keys.

INPUTS is the only list: key bindings, menus, tooltips, hints, the help overlay and
docs/keys.md follow it.  Of those keys that Blender has for something else, it also says what
they are with Blender's keys.
"""

from dataclasses import dataclass, replace

from ...core.render import MODES
from ..settings import KEYS

# pyglet's numbers; the modules that name them can't be imported without a display.
LEFT, MIDDLE, RIGHT = 1, 2, 4
SHIFT, CTRL, ALT = 1, 2, 4


@dataclass(frozen=True)
class Input:
    """A gesture, key or item of a menu, and its action."""

    label: str  # the key or gesture, as the help names it; empty for what only a menu has
    help: str  # what it does
    key: str = ""  # pyglet's name of the key, with CTRL+ and SHIFT+ before it if they are held
    action: str = ""  # what key and menu call, one of ACTIONS
    menu: str = ""  # where it is in the menus, as in "Edit/Undo" or "File/Export/Mesh as OBJ"
    blender: str | None = None  # the key with Blender's keys, if another; empty: none
    only: str = ""  # the one of KEYS that has the gesture, if not all


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
    Input("", "move what is selected; a click or Enter ends it", "", "move", "Edit/Drag/Move", "G"),
    Input("X", "while dragging: along x, along its own x, or freely again", "X", "along_x"),
    Input("Y", "along y", "Y", "along_y"),
    Input("Z", "along z", "Z", "along_z"),
    *(
        Input(
            f"Shift+{key}",
            f"in the plane across {key.lower()}",
            f"SHIFT+{key}",
            f"across_{key.lower()}",
        )
        for key in "XYZ"
    ),
    Input(
        "E", "turn it; while dragging: instead, or move again", "E", "turn", "Edit/Drag/Turn", "R"
    ),
    Input("S", "scale, likewise", "S", "scale", "Edit/Drag/Scale"),
    Input("0 to 9, -, .", "while dragging: by how much; Enter or a click: done"),
    Input("Q", "the gizmo moves, turns, scales, or is off", "Q", "next_gizmo", "Edit/Gizmo/Next"),
    *(
        Input(
            "",
            f"it {kind}s what is selected",
            "",
            f"gizmo_{kind}",
            f"Edit/Gizmo/{kind.capitalize()}",
        )
        for kind in ("move", "turn", "scale")
    ),
    Input("", "nothing but the mouse", "", "gizmo_off", "Edit/Gizmo/Off"),
    Input(
        "Shift+Q", "along the selection's own axes", "SHIFT+Q", "own_axes", "Edit/Gizmo/Own axes"
    ),
    Input(
        "B",
        "select in a box: left drag (Shift adds, Ctrl removes, both intersect)",
        "B",
        "box",
        "Edit/Select/In a box",
    ),
    Input("L", "select in a lasso", "L", "lasso", "Edit/Select/In a lasso"),
    Input(
        "Ctrl+A", "select all red points in sight", "CTRL+A", "select_all", "Edit/Select/All", "A"
    ),
    Input("", "select no point", "", "select_none", "Edit/Select/None", "ALT+A"),
    Input("Ctrl+H", "hide the selected points", "CTRL+H", "hide", "Edit/Hide points", "H"),
    Input(
        "Ctrl+Shift+H",
        "show hidden points",
        "CTRL+SHIFT+H",
        "unhide",
        "Edit/Show all points",
        "ALT+H",
    ),
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
    Input("middle or right drag", "pan", only="deformrf"),
    Input("middle drag", "orbit", only="blender"),
    Input("Shift+middle, or right drag", "pan", only="blender"),
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
    Input(
        "G", "fly with W A S D, Q and E, and the mouse; Esc ends", "G", "fly", "View/Fly", "SHIFT+F"
    ),
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
    Input("R", "reset the deformation; pins come back", "R", "reset", "Edit/Reset", "ALT+G"),
    Input("Space", "pause, or go on", "SPACE", "pause", "Edit/Pause"),
    Input(".", "single step", "PERIOD", "single_step", "Edit/Single step"),
    Input("N", "Pose: what is let go stays; or Physics: it swings back", "N", "pose", "Edit/Pose"),
    Input("M", "next view mode: depth, normals, ...", "M", "next_mode", "View/Next mode"),
    Input(
        "H", "hide or show all points and pins", "H", "toggle_handles", "View/Vertices", "CTRL+H"
    ),
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
    Input(
        "A",
        "animate: drag a bone to turn it, its tip to reach, a root's head to move all",
        "A",
        "bones",
        "Rig/Pose bones",
        "CTRL+TAB",
    ),
    Input("Shift+A", "bones at rest", "SHIFT+A", "rest_bones", "Rig/Bones at rest", "ALT+R"),
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
    *(
        Input(
            "", f"the keys and the mouse are {name}'s", "", f"keys_{keys}", f"Help/Keys of {name}"
        )
        for keys, name in KEYS.items()
    ),
    Input("right click", "while dragging: let go, it goes back"),
    Input("Esc", "likewise; close lists and help", "ESCAPE", "cancel"),
    Input("Ctrl+Q", "quit", "CTRL+Q", "quit", "File/Quit"),
)


OTHER_NAMES = {  # of digits: the number pad's, X11's for it without Num Lock, US Shift+digit
    **{f"NUM_{n}": f"_{n}" for n in range(10)},
    **{"NUM_END": "_1", "NUM_PAGE_DOWN": "_3", "NUM_NEXT": "_3", "NUM_BEGIN": "_5"},
    **{"NUM_HOME": "_7", "NUM_LEFT": "_4", "NUM_RIGHT": "_6", "NUM_UP": "_8", "NUM_DOWN": "_2"},
    **{"EXCLAMATION": "_1", "POUND": "_3", "HASH": "_3", "AMPERSAND": "_7"},
}


def _with_keys(keys):
    """INPUTS as they are with one of KEYS."""
    for entry in INPUTS:
        if entry.only in ("", keys):
            other = keys == "blender" and entry.blender is not None
            yield replace(entry, key=entry.blender, label=_label(entry.blender)) if other else entry


def _label(key):
    """As "Ctrl+Tab" for "CTRL+TAB"."""
    return "+".join(part.capitalize() for part in key.split("+") if part)


_INPUTS = {keys: tuple(_with_keys(keys)) for keys in KEYS}
_ACTIONS = {
    keys: {entry.key: entry.action for entry in inputs if entry.key}
    for keys, inputs in _INPUTS.items()
}


def inputs_of(keys: str) -> tuple[Input, ...]:
    """The inputs that there are with one of KEYS, with their labels and keys."""
    return _INPUTS[keys]


def action_of(key: str, modifiers: int = 0, keys: str = "deformrf") -> str | None:
    """The action of a key, by pyglet's name of it and the modifiers that are held.

    Shift or Alt alone changes no key that has no action with it.
    """
    actions, key = _ACTIONS[keys], OTHER_NAMES.get(key, key)
    ctrl, alt, shift = (bool(modifiers & one) for one in (CTRL, ALT, SHIFT))
    found = actions.get("CTRL+" * ctrl + "ALT+" * alt + "SHIFT+" * shift + key)
    if found is None and alt:
        found = action_of(key, modifiers & ~ALT, keys)
    return actions.get(key) if found is None and not ctrl else found


def label_of(action: str, keys: str) -> str:
    """The key that calls an action, as shown to the user; empty if it has none."""
    return next(entry.label for entry in inputs_of(keys) if entry.action == action)
