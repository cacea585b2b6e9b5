"""The section on dynamics: material, surroundings, and time."""

import math
from functools import partial

from imgui_bundle import imgui

from ...core.deform import HELD_SHARE, LOWEST_POISSON_RATIO, PRESETS, TIME_STEP, Material
from ..document import EARTH
from ..layers import line_spacing
from ..settings import DELETING, GRAB_RADII, TOOLS
from .gizmo import gizmo_switch
from .widgets import LOGARITHMIC, button, checkbox, combo, number_setting, setting, slider, with_key

YOUNG_MODULI = 1e3, 1e9  # Pa
POISSON_RATIOS = 0.0, 0.49
DAMPINGS = 0.0, 20.0  # 1/s
SUBSTEP_COUNTS = 1, 500
GRAVITIES = 0.1, 3.0 * EARTH
SIZES = 0.01, 100.0  # m
YIELD_STRAINS = 0.0, 0.5
AIR_DRAGS = 0.0, 10.0  # 1/s
WINDS = -20.0, 20.0  # m/s
MATERIALS = {"default": Material(), **PRESETS}
CUSTOM = "custom"  # the name of a material that is none of these
PRICE = "what they took of each 60th of a second when the object moved last"
HOLDS = "about the stiffness (Young's modulus) that the object has with these substeps"
SUBSTEPS = "steps of the solver in a 60th of a second: more are slower, and hold stiffer materials"
AUTOMATIC = "as many substeps as hold the stiffness, up to a quarter of the time"
POISSON = "how much it gets thinner where it is stretched: near 0.5 it keeps its volume"
DAMPING = "how fast vibrations fade"

TOOL = """what a left drag does: grab a vertex, push with a ball ({toggle_push}),
make stiffer or softer what the mouse passes, within the grab radius, or delete
({delete}: brush, {delete_box}: box, {delete_lasso}: lasso)"""
OF_TOOLS = "toggle_push", "delete", "delete_box", "delete_lasso"
SIZE = "longest side: what is smaller is stiffer for its weight, and moves faster"
HELD_BY = {
    "pins": "its pins",
    "weight": "its weight",
    "wind": "the wind",
    "colliders": "what it touches",
}
YIELD = "how far edges are strained before they stay so"
AIR = "how fast it brakes what moves"


def deform_panel(app):
    scene = app.scene
    _time_buttons(app)
    _material(scene)
    _shape(app)
    _tool(app)
    _grab(scene.settings)
    gizmo_switch(app)
    _substeps(app)
    _surroundings(scene)
    imgui.text_disabled(vertex_line(scene))
    imgui.set_item_tooltip("the id that --drag takes")
    if len(scene.handles.selected) == 1:
        (handle,) = scene.handles.selected
        changed, text = imgui.input_text("name", scene.handles.names.get(handle, ""))
        if changed:
            scene.handles.name(handle, text)


def vertex_line(scene) -> str:
    """Which vertex is held or under the mouse; a line in any case, or the panel would jump."""
    handles = scene.handles
    if handles.grabbed is not None:
        several = f" and {len(handles.grabbed.handles) - 1} more"
        return f"holding {handles.title(handles.grabbed.handles[0])}" + several * (
            len(handles.grabbed.handles) > 1
        )
    if handles.hover is not None:
        return handles.title(handles.hover)
    return f"{len(handles.selected)} selected" if handles.selected else "nothing under the mouse"


def _time_buttons(app):
    button("Go on" if app.scene.paused else "Pause", app, "pause")
    imgui.same_line()
    button("Step", app, "single_step", "one 60th of a second")
    imgui.same_line()
    button("Reset", app, "reset", "back to the rest pose")
    imgui.same_line()
    imgui.text_disabled(state_line(app.scene))


def state_line(scene) -> str:
    if scene.solver.rescue.running:
        return "rescuing ..."
    if scene.solver.rescue.given_up:
        return "tangled: take Reset"
    if scene.solver.rescue.held_by:
        return f"folded by {HELD_BY[scene.solver.rescue.held_by]}"
    return "paused" if scene.paused else "moving" if scene.moving else "at rest"


def name_of(material) -> str:
    """The panel's name for a material."""
    return next((name for name, preset in MATERIALS.items() if preset == material), CUSTOM)


def _material(scene):
    def choose(name):
        if name != CUSTOM:
            scene.body.set_material(**vars(MATERIALS[name]))

    combo("material", name_of(scene.body.material), [*MATERIALS, CUSTOM], choose)
    modulus = f"{si(scene.body.material.young_modulus)}Pa"
    _material_slider(
        scene, "stiffness", "young_modulus", YOUNG_MODULI, modulus, LOGARITHMIC, "Young's modulus"
    )
    _material_slider(scene, "Poisson ratio", "poisson_ratio", POISSON_RATIOS, "%.2f", 0, POISSON)
    if scene.body.material.poisson_ratio < LOWEST_POISSON_RATIO:
        imgui.text(f"{LOWEST_POISSON_RATIO} is held: springs can't follow a lower ratio")
    _material_slider(scene, "damping", "damping", DAMPINGS, "%.1f per s", 0, DAMPING)
    slider("size", scene.body.meters, SIZES, "%.3g m", scene.body.set_meters, LOGARITHMIC, SIZE)


def _material_slider(scene, label, name, bounds, text, flags=0, tooltip=""):
    def change(value):
        scene.body.set_material(**{name: value})

    slider(label, getattr(scene.body.material, name), bounds, text, change, flags, tooltip)


def _shape(app):
    """What the object keeps of a pose."""

    def change(strain):
        body.set_material(yield_strain=strain or math.inf)

    body = app.scene.body
    strain = 0.0 if math.isinf(body.material.yield_strain) else body.material.yield_strain
    text = "strain %.2f" if strain else "never"
    slider("yields", strain, YIELD_STRAINS, text, change, tooltip=YIELD)
    button("Rest here", app, "rest_here", "return to this pose")
    if body.rests_elsewhere:
        imgui.same_line()
        button("As before", app, "undo_rest_here", "return to the shape before")


def _tool(app):
    settings, body = app.scene.settings, app.scene.body
    told = TOOL.format(**{action: with_key(app, action) for action in OF_TOOLS})
    combo("tool", settings.tool, TOOLS, partial(setattr, settings, "tool"), told)
    if app.scene.settings.tool in DELETING or app.scene.cuts.some:
        _delete(app)
    if body.factors is not None:
        button("Even", app, "clear_paint", "equally stiff")
        imgui.same_line()
        button("Save stiffness", app, "save_model", "in a copy of the model, here")


def _delete(app):
    """What is left, and what belongs to the tools that delete."""
    kept = app.scene.cuts.kept
    imgui.text_disabled(f"{int(kept.sum()):,} of {len(kept):,} tets are left")
    button("Specks", app, "delete_specks", "delete parts with less than 1 % of the matter")
    imgui.same_line()
    button("Save smaller model", app, "save_model", "without what was deleted, here")


def _grab(settings):
    number_setting("grab radius", settings, "grab_radius", GRAB_RADII, "%.2f of the size")
    tooltip = "pull with springs, weaker towards the radius, instead of moving exactly"
    setting("soft grab", settings, "soft_grab", tooltip)
    imgui.same_line()
    setting("grab anywhere", settings, "grab_anywhere", "on the object, not only at red points")


def _substeps(app):
    def change(count):
        body.set_options(substep_count=count)

    body, count = app.scene.body, app.scene.solver.options.substep_count
    slider("substeps", count, SUBSTEP_COUNTS, "%.0f", change, LOGARITHMIC, SUBSTEPS)
    checkbox("automatic", body.automatic_substeps, body.set_automatic_substeps, AUTOMATIC)
    imgui.same_line()
    seconds = app.times.tick_seconds()
    imgui.text_disabled(f"{1e3 * seconds:.1f} of {1e3 * TIME_STEP:.1f} ms")
    imgui.set_item_tooltip(PRICE)
    asked, held = body.material.young_modulus, body.held_young_modulus
    if held < HELD_SHARE * asked:
        why = "more are too slow" if body.automatic_substeps else "take more substeps"
        imgui.text(f"holds {si(held, 2)}Pa of {si(asked)}Pa: {why}")
    else:
        imgui.text_disabled(f"holds {si(asked)}Pa")
    imgui.set_item_tooltip(HOLDS)


def _surroundings(scene):
    checkbox("held", scene.held, scene.hold, "by its lowest part; off lets all pins go")
    imgui.same_line()
    tooltip = f"under the object at rest; its lines are {line_spacing(scene):g} m apart"
    checkbox("ground", scene.on_ground, scene.set_ground, tooltip)
    imgui.same_line()
    contact = partial(_set_contact, scene.body)
    checkbox("contact", scene.solver.options.contact, contact, "it collides with itself")
    on = scene.body.gravity > 0.0
    checkbox("gravity", on, lambda wanted: scene.set_gravity(EARTH if wanted else 0.0))
    if on:
        slider("strength", scene.body.gravity, GRAVITIES, "%.1f m/s²", scene.set_gravity)
    body = scene.body
    slider("air drag", body.air_drag, AIR_DRAGS, "%.1f per s", body.set_air_drag, tooltip=AIR)
    if body.air_drag:
        slider("wind", body.wind, WINDS, "%.1f m/s", body.set_wind, tooltip="along x")


def _set_contact(body, on):
    body.set_options(contact=on)


def si(value: float, digits: int = 3) -> str:
    """A number of so many digits with a prefix: 500000 -> '500 k'."""
    value = float(f"{value:.{digits}g}")
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= factor:
            return f"{value / factor:.3g} {prefix}"
    return f"{value:.3g} "
