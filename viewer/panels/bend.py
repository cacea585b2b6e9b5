"""The task *Bend*: the hand, the material, what surrounds the object, and time."""

import math

from imgui_bundle import imgui

from ...core.deform import HELD_SHARE, LOWEST_POISSON_RATIO, PRESETS, TIME_STEP, Material
from ..document import EARTH
from ..layers import line_spacing
from ..settings import DELETING, GIZMOS, GRAB_RADII
from . import widgets as w

MATERIALS = {"default": Material(), **PRESETS}
PRICE = "what they took of each 60th of a second when the object moved last"
HOLDS = "about the stiffness (Young's modulus) that the object has with these substeps"
SUBSTEPS = "steps of the solver in a 60th of a second: more are slower, and hold stiffer materials"
AUTOMATIC = "as many substeps as hold the stiffness, up to a quarter of the time"
POISSON = "how much it gets thinner where it is stretched: near 0.5 it keeps its volume"
SIZE = "longest side: what is smaller is stiffer for its weight, and moves faster"
YIELD = "how far edges are strained before they stay so"
TAKES = "how far around the mouse a drag takes the object along; the wheel does it, too"
ANYWHERE = "on the object, not only at red points"
SOFT = "pull with springs, weaker towards the radius, instead of moving exactly"
AMOUNTS = {  # by which the gizmo can move, turn or scale: an example, and the unit
    "move": ("0.1", "in sizes of the object"),
    "turn": ("45", "in degrees"),
    "scale": ("1.5", "a factor"),
}
AMOUNT_WIDTH = 88.0  # points
STEPS_SHOWN = 8  # of what was done


def bend_panel(scene, body, cuts, handles, settings, controls, gui, times, actions):
    """What a beginner needs first; physics under *Advanced*."""
    w.buttons(actions, "pause", "reset", "rest_here", *["undo_rest_here"] * body.rests_elsewhere)
    if w.section("Hand"):
        text = f"{100.0 * settings.grab_radius:.0f} %% of its size"
        w.slider("takes along", *w.of(settings, "grab_radius"), GRAB_RADII, text, 0, TAKES)
        w.checkbox("grab anywhere", *w.of(settings, "grab_anywhere"), ANYWHERE)
        imgui.same_line(0.0, w.APART)
        w.checkbox("soft grip", *w.of(settings, "soft_grab"), SOFT)
        _gizmo(settings, controls, gui, actions)
        _selection(handles)
        _tool_options(settings, cuts, body, actions)
    if w.section("Material"):
        w.combo("material", body.material, lambda one: body.set_material(**vars(one)), MATERIALS)
        text, stiffness = f"{si(body.material.young_modulus)}Pa", _material(body, "young_modulus")
        w.slider("stiffness", *stiffness, (1e3, 1e9), text, w.LOGARITHMIC, "Young's modulus")
    if w.section("World"):
        _world(scene, body)
    if w.section("Advanced", is_open=False):
        _advanced(body, times, actions)


def _gizmo(settings, controls, gui, actions) -> None:
    """What the gizmo does, and along which axes."""
    words = {kind: kind.capitalize() for kind in GIZMOS}
    told = actions.told("next_gizmo")
    w.segments(words, *w.of(settings, "gizmo"), lambda kind: told)
    imgui.same_line()
    w.buttons(actions, "own_axes")
    gizmo = controls.tool.gizmo
    if gizmo is not None and imgui.tree_node("by numbers"):
        _amount(controls, gui, gizmo.kind)
        imgui.tree_pop()


def _amount(controls, gui, kind):
    """A number, and buttons that move, turn or scale by it."""
    example, unit = AMOUNTS[kind]
    gui.amount = w.text_field("##amount", gui.amount, example, AMOUNT_WIDTH)
    imgui.set_item_tooltip(unit)
    for axis, name in enumerate("xyz"):
        imgui.same_line()
        if imgui.button(f"{kind} {name}"):
            controls.apply(gui.amount, axis)


def _selection(handles):
    """What is held, selected or under the mouse; a name for one handle."""
    imgui.text_disabled(vertex_line(handles))
    if len(handles.selected) == 1:
        (handle,) = handles.selected
        imgui.set_item_tooltip(f"deformrf view --drag takes it as {handle}")
        changed, text = imgui.input_text(w.named("name"), handles.names.get(handle, ""))
        if changed:
            handles.name(handle, text)


def vertex_line(handles) -> str:
    """What is held, selected and under the mouse; a line in any case, or the panel would jump."""
    grabbed, count = handles.grabbed, len(handles.selected)
    if grabbed is not None:
        first, more = grabbed.handles[0], len(grabbed.handles) - 1
        return f"holding {handles.title(first)}" + f" and {more} more" * (more > 0)
    line = f"{count} point{'s' * (count != 1)} selected" if count else "nothing selected"
    return line if handles.hover is None else f"{line}; mouse on {handles.title(handles.hover)}"


def _material(body, name):
    """An attribute of the material, as `w.of` has those of others."""
    return getattr(body.material, name), lambda value: body.set_material(**{name: value})


def _option(body, name):
    """One of the solver's options, likewise."""
    return getattr(body.solver.options, name), lambda value: body.set_options(**{name: value})


def _tool_options(settings, cuts, body, actions):
    """What belongs to the tools that delete, and that paint."""
    has_deleted = settings.tool in DELETING or cuts.some
    if has_deleted:
        imgui.text_disabled(f"{int(cuts.kept.sum()):,} of {len(cuts.kept):,} tets are left")
    painted = body.factors is not None
    names = ["delete_specks"] * has_deleted + ["clear_paint"] * painted
    if names:
        w.buttons(actions, *names, "save_model")


def _world(scene, body):
    """What the object is held by, and what it meets."""
    w.checkbox("foot held", scene.held, scene.hold, "by its lowest part; off lets all pins go")
    imgui.same_line(0.0, w.APART)
    apart = f"its lines are {line_spacing(body.meters):g} m apart"
    tooltip = f"what the object can fall and lie on; {apart}"
    w.checkbox("solid ground", scene.on_ground, scene.set_ground, tooltip)
    imgui.same_line(0.0, w.APART)
    on = body.gravity > 0.0
    w.checkbox("gravity", on, lambda wanted: scene.set_gravity(EARTH if wanted else 0.0))
    if on:
        w.slider("strength", body.gravity, scene.set_gravity, (0.1, 3.0 * EARTH), "%.1f m/s²")


def _advanced(body, times, actions):
    """Physics: the rest of the material, the air, and the solver."""
    w.buttons(actions, "single_step")
    poisson, damping = _material(body, "poisson_ratio"), _material(body, "damping")
    w.slider("Poisson ratio", *poisson, (0.0, 0.49), "%.2f", 0, POISSON)
    if body.material.poisson_ratio < LOWEST_POISSON_RATIO:
        imgui.text(f"{LOWEST_POISSON_RATIO} is held: springs can't follow a lower ratio")
    w.slider("damping", *damping, (0.0, 20.0), "%.1f per s", 0, "how fast vibrations fade")
    w.slider("size", body.meters, body.set_meters, (0.01, 100.0), "%.3g m", w.LOGARITHMIC, SIZE)
    strain, change = _material(body, "yield_strain")
    shown, text = (0.0, "never") if math.isinf(strain) else (strain, "strain %.2f")
    w.slider("yields", shown, lambda at: change(at or math.inf), (0.0, 0.5), text, 0, YIELD)
    w.checkbox("contact", *_option(body, "contact"), "it collides with itself")
    drag, told = (body.air_drag, body.set_air_drag), "how fast it brakes what moves"
    w.slider("air drag", *drag, (0.0, 10.0), "%.1f per s", tooltip=told)
    if body.air_drag:
        w.slider("wind", body.wind, body.set_wind, (-20.0, 20.0), "%.1f m/s", tooltip="along x")
    _substeps(body, times)


def _substeps(body, times):
    count = _option(body, "substep_count")
    w.slider("substeps", *count, (1, 500), "%.0f", w.LOGARITHMIC, SUBSTEPS)
    w.checkbox("automatic", body.automatic_substeps, body.set_automatic_substeps, AUTOMATIC)
    imgui.same_line()
    seconds = times.tick_seconds()
    imgui.text_disabled(f"{1e3 * seconds:.1f} of {1e3 * TIME_STEP:.1f} ms")
    imgui.set_item_tooltip(PRICE)
    asked, held = body.material.young_modulus, body.held_young_modulus
    if held < HELD_SHARE * asked:
        why = "more are too slow" if body.automatic_substeps else "take more substeps"
        imgui.text_wrapped(f"holds {si(held, 2)}Pa of {si(asked)}Pa: {why}")
    else:
        imgui.text_disabled(f"holds {si(asked)}Pa")
    imgui.set_item_tooltip(HOLDS)


def si(value: float, digits: int = 3) -> str:
    """A number of so many digits with a prefix: 500000 -> '500 k'."""
    value = float(f"{value:.{digits}g}")
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= factor:
            return f"{value / factor:.4g} {prefix}"
    return f"{value:.3g} "


# -- what was done -----------------------------------------------------------------------------


def history_panel(journal, actions):
    w.buttons(actions, "undo", "redo", "save_session")
    for line, undone in shown_steps(journal):
        (imgui.text_disabled if undone else imgui.text)(line)


def shown_steps(journal):
    """The steps around the cursor: each one's line, and whether it is undone."""
    count = len(journal.steps)
    if not count:
        return [("nothing was changed yet", True)]
    first = max(min(journal.cursor - STEPS_SHOWN // 2, count - STEPS_SHOWN), 0)
    numbers = range(first, min(first + STEPS_SHOWN, count))
    return [(f"{n + 1}  {journal.steps[n].label}", n >= journal.cursor) for n in numbers]
