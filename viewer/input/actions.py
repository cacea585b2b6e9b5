"""User actions: the functions that keys and menus call, by the names that inputs.py has."""

from functools import partial
from operator import attrgetter

from ...core.render import MODES
from ..files import ask_for_file, surface_of
from ..settings import DELETING, GIZMOS, KEYS, OF_BONES, PANEL_WIDTHS, SIDES
from .constraints import KINDS
from .delete_actions import DELETE_ACTIONS
from .rig_actions import RIG_ACTIONS
from .timeline_actions import TIMELINE_ACTIONS
from .view_actions import VIEW_ACTIONS


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
        if app.controls.free:
            app.controls.cancel()
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


def _turn_into(kind, app):
    app.fly.end()
    if app.gui is not None and app.gui.mouse_on_panel:  # a menu: nobody has told the controls
        app.controls.pointer = app.gui.pointer * app.controls.ratio
    app.controls.turn_into(kind)


def _along(axis, across):
    """A function that holds the drag in progress to an axis, or to the plane across it."""
    return lambda app: app.controls.along(axis, across)


def _next_gizmo(app):
    settings = app.scene.settings
    settings.gizmo = GIZMOS[(GIZMOS.index(settings.gizmo) + 1) % len(GIZMOS)]
    app.recorder.say(f"gizmo: {settings.gizmo}")


def _choose_keys(keys):
    """A function that takes one of KEYS, and offers them no longer."""
    choose = _choose("keys", keys)

    def take(app):
        choose(app)
        app.scene.settings.has_chosen_keys = app.preferences.has_chosen_keys = True
        app.preferences.keys = keys
        app.recorder.say(app.preferences.save() or f"keys: {KEYS[keys]}'s")

    take.is_on = choose.is_on
    return take


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
    **{f"along_{'xyz'[axis]}": _along(axis, False) for axis in range(3)},
    **{f"across_{'xyz'[axis]}": _along(axis, True) for axis in range(3)},
    **{kind: partial(_turn_into, kind) for kind in KINDS},
    "next_gizmo": _next_gizmo,
    **{f"gizmo_{kind}": _choose("gizmo", kind) for kind in GIZMOS},
    "own_axes": _toggle("own_axes"),
    **{f"keys_{keys}": _choose_keys(keys) for keys in KEYS},
    "box": _tool("box"),
    "lasso": _tool("lasso"),
    "select_all": _select_all,
    "select_none": lambda app: app.scene.handles.select([]),
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
