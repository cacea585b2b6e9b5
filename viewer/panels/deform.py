"""What the object is made of, and its time."""

from imgui_bundle import imgui

from ...core.deform import COMPLIANCE_FLOOR, LOWEST_POISSON_RATIO, PRESETS
from ..controls import label_of
from ..scene import EARTH

SOFTEST, STIFFEST = 1e3, 1e9  # Pa
POISSON_RANGE = 0.0, 0.49
HIGHEST_DAMPING = 20.0  # 1/s
HIGHEST_GRAB_RADIUS = 0.4  # object sizes
MOST_SUBSTEPS = 60
STRONGEST_GRAVITY = 3.0 * EARTH
CUSTOM = "custom"  # the name of a material that is none of PRESETS


def deform_panel(scene, actions, status):
    _time_buttons(scene, actions)
    _material_choice(scene)
    _material_sliders(scene)
    _grab_choice(scene.settings)
    _solver_options(scene)
    _surroundings(scene)
    imgui.text_disabled(vertex_line(scene))
    imgui.set_item_tooltip("the id that --drag takes")


def _grab_choice(settings):
    changed, radius = imgui.slider_float(
        "grab radius", settings.grab_radius, 0.0, HIGHEST_GRAB_RADIUS, "%.2f of the size"
    )
    if changed:
        settings.grab_radius = radius
    changed, soft = imgui.checkbox("soft grab", settings.soft_grab)
    imgui.set_item_tooltip(
        "pull with springs, weaker towards the radius, instead of moving exactly"
    )
    if changed:
        settings.soft_grab = soft


def vertex_line(scene) -> str:
    """Which vertex is held or under the mouse; a line in any case, or the panel would jump."""
    if scene.grabbed is not None:
        return f"holding vertex {scene.grabbed.vertex}"
    return "no vertex under the mouse" if scene.hover is None else f"vertex {scene.hover}"


def _time_buttons(scene, actions):
    if imgui.button("Go on" if scene.paused else "Pause"):
        actions.pause()
    imgui.set_item_tooltip(label_of("pause"))
    imgui.same_line()
    if imgui.button("Step"):
        actions.single_step()
    imgui.set_item_tooltip(f"one 60th of a second ({label_of('single_step')})")
    imgui.same_line()
    if imgui.button("Reset"):
        actions.reset()
    imgui.set_item_tooltip(f"back to the rest pose ({label_of('reset')})")
    imgui.same_line()
    imgui.text_disabled(state_line(scene))


def state_line(scene) -> str:
    """What time does to the object."""
    if scene.solver.rescuing:
        return "rescuing ..."
    if scene.solver.given_up:
        return "tangled: take Reset"
    return "paused" if scene.paused else "moving" if scene.moving else "at rest"


def _material_choice(scene):
    names = [*PRESETS, CUSTOM]
    changed, chosen = imgui.combo("material", names.index(name_of(scene.material)), names)
    if changed and names[chosen] != CUSTOM:
        scene.set_material(**vars(PRESETS[names[chosen]]))


def name_of(material) -> str:
    """What the panel calls a material."""
    return next((name for name, preset in PRESETS.items() if preset == material), CUSTOM)


def _material_sliders(scene):
    material = scene.material
    changed, modulus = imgui.slider_float(
        "stiffness",
        material.young_modulus,
        SOFTEST,
        STIFFEST,
        f"{si(material.young_modulus)}Pa",
        imgui.SliderFlags_.logarithmic.value,
    )
    imgui.set_item_tooltip("Young's modulus")
    if changed:
        scene.set_material(young_modulus=modulus)
    changed, ratio = imgui.slider_float(
        "Poisson ratio", material.poisson_ratio, *POISSON_RANGE, "%.2f"
    )
    if changed:
        scene.set_material(poisson_ratio=ratio)
    if material.poisson_ratio < LOWEST_POISSON_RATIO:
        imgui.text(f"{LOWEST_POISSON_RATIO} is held: springs can't follow a lower ratio")
    changed, damping = imgui.slider_float(
        "damping", material.damping, 0.0, HIGHEST_DAMPING, "%.1f per s"
    )
    if changed:
        scene.set_material(damping=damping)


def _solver_options(scene):
    changed, count = imgui.slider_int(
        "substeps", scene.solver.options.substep_count, 1, MOST_SUBSTEPS
    )
    if changed:
        scene.set_substeps(count)
    ratio, modulus = scene.stiffness
    imgui.text_disabled(f"r = {ratio:.2g}, holds {si(modulus)}Pa")
    imgui.set_item_tooltip(
        "compliance against inertia in a substep: below 1 more substeps make it stiffer,\n"
        f"below {COMPLIANCE_FLOOR} it is softer than asked for"
    )
    if ratio < COMPLIANCE_FLOOR:
        imgui.text("softened: take more substeps")


def _surroundings(scene):
    changed, held = imgui.checkbox("held", scene.held)
    imgui.set_item_tooltip("by its lowest part; off lets all pins go")
    if changed:
        scene.hold(held)
    imgui.same_line()
    changed, on = imgui.checkbox("ground", scene.on_ground)
    imgui.set_item_tooltip("under the object at rest")
    if changed:
        scene.set_ground(on)
    imgui.same_line()
    changed, on = imgui.checkbox("gravity", scene.gravity > 0.0)
    if changed:
        scene.set_gravity(EARTH if on else 0.0)
    elif on:
        changed, strength = imgui.slider_float(
            "strength", scene.gravity, 0.1, STRONGEST_GRAVITY, "%.1f m/s²"
        )
        if changed:
            scene.set_gravity(strength)


def si(value: float) -> str:
    """A number with a prefix: 500000 -> '500 k'."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= factor:
            return f"{value / factor:.3g} {prefix}"
    return f"{value:.3g} "
