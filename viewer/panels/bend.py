"""The task *Bend*: the hand, the material, what surrounds the object, and time."""

import math
from functools import partial

from imgui_bundle import imgui

from ...core.deform import HELD_SHARE, LOWEST_POISSON_RATIO, PRESETS, TIME_STEP, Material
from ..document import EARTH
from ..layers import line_spacing
from ..settings import DELETING, GRAB_RADII
from .gizmo import gizmo_switch
from .widgets import (
    LOGARITHMIC,
    beside,
    button,
    checkbox,
    combo,
    named,
    number_setting,
    section,
    setting,
    slider,
)

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

SIZE = "longest side: what is smaller is stiffer for its weight, and moves faster"
HELD_BY = {
    "pins": "its pins",
    "weight": "its weight",
    "wind": "the wind",
    "colliders": "what it touches",
}
YIELD = "how far edges are strained before they stay so"
AIR = "how fast it brakes what moves"
TAKES = "how far around the mouse a drag takes the object along; the wheel does it, too"
SOFT = "pull with springs, weaker towards the radius, instead of moving exactly"


def bend_panel(scene, clock, solver, body, cuts, handles, settings, controls, gui, times, actions):
    """What a beginner needs first; physics under *Advanced*."""
    _time_buttons(clock, solver, actions)
    if section("Hand"):
        number_setting("takes along", settings, "grab_radius", GRAB_RADII, "%.2f of it", 0, TAKES)
        setting("grab anywhere", settings, "grab_anywhere", "on the object, not only at red points")
        imgui.same_line()
        setting("soft grip", settings, "soft_grab", SOFT)
        gizmo_switch(settings, controls, gui, actions)
        _selection(handles)
        _tool_options(settings, cuts, body, actions)
    if section("Material"):
        combo("material", name_of(body.material), [*MATERIALS, CUSTOM], partial(_choose, body))
        text = f"{si(body.material.young_modulus)}Pa"
        _material_slider(
            body, "stiffness", "young_modulus", YOUNG_MODULI, text, LOGARITHMIC, "Young's modulus"
        )
        _shape(body, actions)
    if section("World"):
        _world(scene, body)
    if section("Advanced", is_open=False):
        _advanced(body, times, actions)


def _choose(body, name):
    if name != CUSTOM:
        body.set_material(**vars(MATERIALS[name]))


def _selection(handles):
    """What is held, selected or under the mouse; a name for one handle."""
    imgui.text_disabled(vertex_line(handles))
    imgui.set_item_tooltip("the id that --drag takes")
    if len(handles.selected) == 1:
        (handle,) = handles.selected
        changed, text = imgui.input_text(named("name"), handles.names.get(handle, ""))
        if changed:
            handles.name(handle, text)


def vertex_line(handles) -> str:
    """Which vertex is held or under the mouse; a line in any case, or the panel would jump."""
    if handles.grabbed is not None:
        several = f" and {len(handles.grabbed.handles) - 1} more"
        return f"holding {handles.title(handles.grabbed.handles[0])}" + several * (
            len(handles.grabbed.handles) > 1
        )
    if handles.hover is not None:
        return handles.title(handles.hover)
    return f"{len(handles.selected)} selected" if handles.selected else "nothing under the mouse"


def _time_buttons(clock, solver, actions):
    button("Go on" if clock.paused else "Pause", actions, "pause")
    imgui.same_line()
    button("Original shape", actions, "reset", "back to how it was at rest, with its pins")
    imgui.same_line()
    imgui.text_disabled(state_line(clock, solver))


def state_line(clock, solver) -> str:
    if solver.rescue.running:
        return "rescuing ..."
    if solver.rescue.given_up:
        return "tangled: take Original shape"
    if solver.rescue.held_by:
        return f"folded by {HELD_BY[solver.rescue.held_by]}"
    return "paused" if clock.paused else "moving" if clock.moving else "at rest"


def name_of(material) -> str:
    """The panel's name for a material."""
    return next((name for name, preset in MATERIALS.items() if preset == material), CUSTOM)


def _material_slider(body, label, name, bounds, text, flags=0, tooltip=""):
    def change(value):
        body.set_material(**{name: value})

    slider(label, getattr(body.material, name), bounds, text, change, flags, tooltip)


def _shape(body, actions):
    """What the object keeps of a pose."""
    button("Make this its shape", actions, "rest_here", "it returns to this pose from now on")
    if body.rests_elsewhere:
        imgui.same_line()
        button("Shape before", actions, "undo_rest_here", "return to the shape before")


def _tool_options(settings, cuts, body, actions):
    """What belongs to the tools that delete, and that paint."""
    if settings.tool in DELETING or cuts.some:
        imgui.text_disabled(f"{int(cuts.kept.sum()):,} of {len(cuts.kept):,} tets are left")
        button("Specks", actions, "delete_specks", "delete parts with less than 1 % of the matter")
        beside("Save smaller model")
        button("Save smaller model", actions, "save_model", "without what was deleted, here")
    if body.factors is not None:
        button("Even", actions, "clear_paint", "equally stiff")
        imgui.same_line()
        button("Save stiffness", actions, "save_model", "in a copy of the model, here")


def _world(scene, body):
    """What the object is held by, and what it meets."""
    checkbox("foot held", scene.held, scene.hold, "by its lowest part; off lets all pins go")
    imgui.same_line()
    tooltip = f"under the object at rest; its lines are {line_spacing(body.meters):g} m apart"
    checkbox("ground", scene.on_ground, scene.set_ground, tooltip)
    imgui.same_line()
    on = body.gravity > 0.0
    checkbox("gravity", on, lambda wanted: scene.set_gravity(EARTH if wanted else 0.0))
    if on:
        slider("strength", body.gravity, GRAVITIES, "%.1f m/s²", scene.set_gravity)


def _advanced(body, times, actions):
    """Physics: the rest of the material, the air, and the solver."""
    button("Single step", actions, "single_step", "one 60th of a second; it pauses")
    _material_slider(body, "Poisson ratio", "poisson_ratio", POISSON_RATIOS, "%.2f", 0, POISSON)
    if body.material.poisson_ratio < LOWEST_POISSON_RATIO:
        imgui.text(f"{LOWEST_POISSON_RATIO} is held: springs can't follow a lower ratio")
    _material_slider(body, "damping", "damping", DAMPINGS, "%.1f per s", 0, DAMPING)
    slider("size", body.meters, SIZES, "%.3g m", body.set_meters, LOGARITHMIC, SIZE)
    _yielding(body)
    contact = partial(_set_contact, body)
    checkbox("contact", body.solver.options.contact, contact, "it collides with itself")
    slider("air drag", body.air_drag, AIR_DRAGS, "%.1f per s", body.set_air_drag, tooltip=AIR)
    if body.air_drag:
        slider("wind", body.wind, WINDS, "%.1f m/s", body.set_wind, tooltip="along x")
    _substeps(body, times)


def _yielding(body):
    def change(strain):
        body.set_material(yield_strain=strain or math.inf)

    strain = 0.0 if math.isinf(body.material.yield_strain) else body.material.yield_strain
    text = "strain %.2f" if strain else "never"
    slider("yields", strain, YIELD_STRAINS, text, change, tooltip=YIELD)


def _substeps(body, times):
    def change(count):
        body.set_options(substep_count=count)

    count = body.solver.options.substep_count
    slider("substeps", count, SUBSTEP_COUNTS, "%.0f", change, LOGARITHMIC, SUBSTEPS)
    checkbox("automatic", body.automatic_substeps, body.set_automatic_substeps, AUTOMATIC)
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


def _set_contact(body, on):
    body.set_options(contact=on)


def si(value: float, digits: int = 3) -> str:
    """A number of so many digits with a prefix: 500000 -> '500 k'."""
    value = float(f"{value:.{digits}g}")
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= factor:
            return f"{value / factor:.4g} {prefix}"
    return f"{value:.3g} "
