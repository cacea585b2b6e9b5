"""The user's choices for picture, handles and files: plain data, without methods.

A choice that files keep says in which, and which values a file may give it: "session" (what films
show, too), "project" (besides what sessions have) or "preferences".
"""

from dataclasses import dataclass, field, fields

from ..core.base.schema import Check, flag, number, one_of, vector
from ..core.render import MODES

DELETING = "delete", "delete box", "delete lasso"
OF_BONES = "joints", "bones"
ORBIT_KEYS = "alt", "ctrl", "shift"
TOOLS = "grab", "box", "lasso", "push", "stiffen", "soften", *DELETING, "isolate", *OF_BONES
SURFACES = "hidden", "plain", "strain", "volume ratio"  # of the coarse mesh
MESH_RANGES = 0.01, 1.0
SMALLEST_SIDE, LARGEST_SIDE = 32, 8192  # of images and films [pixels]
SIDES = "left", "right"
THEMES = "dark", "light"
TASKS = "bend", "rig", "animate", "film", "view"  # what the panel is about
SCALES = 0.5, 4.0  # of the panels, over what the system says
KEYS = {"deformrf": "deformrf", "blender": "Blender"}  # whose keys these are
GIZMOS = "move", "turn", "scale", "off"
HANDS = "physics", "pose"  # what becomes of what a hand lets go: it swings back, or stays
PHOTOGRAPHS = "hidden", "over", "beside"  # the render
GRAB_RADII = 0.0, 0.4  # object sizes
PANEL_WIDTHS = 260.0, 700.0  # points
TARGETS, TARGET_FPS, CPU_TARGET_FPS = (2.0, 120.0), 60.0, 10.0  # frames a second
share = number(0.0, 1.0)


def kept(default, *files: str, good: Check = flag):
    """A choice that these files keep; `good` says whether it can have a value."""
    return field(default=default, metadata={"good": good, "files": files})


@dataclass
class Settings:
    """The choices that the panels show."""

    mode: str = kept("color", "session", good=one_of(MODES))  # what the picture shows
    background: tuple[float, float, float] = kept(
        (1.0, 1.0, 1.0), "session", "preferences", good=vector(3, share)
    )
    checkerboard: bool = kept(False, "session")  # behind the object instead of the background
    # What a drag takes along, in object sizes.
    grab_radius: float = kept(0.08, "project", "preferences", good=number(*GRAB_RADII))
    grab_anywhere: bool = kept(True, "preferences")  # not only at red points
    # With it a drag on the object orbits.
    orbit_key: str = kept("alt", "preferences", good=one_of(ORBIT_KEYS))
    soft_grab: bool = kept(False, "project")  # pull by springs, weaker towards the radius
    hand: str = kept("physics", "project", "preferences", good=one_of(HANDS))
    gizmo: str = kept("move", "project", "preferences", good=one_of(GIZMOS))  # of the selection
    own_axes: bool = kept(False, "project", "preferences")  # the gizmo's are the selection's
    keys: str = kept("deformrf", "preferences", good=one_of(KEYS))
    tool: str = "grab"  # what a left drag does, one of TOOLS
    fixed_resolution: float | None = None  # a factor; without it, what target_fps allows
    target_fps: float = TARGET_FPS
    accumulate: bool = True  # at rest, go on to the mean of shifted images
    show_handles: bool = kept(True, "session")
    show_wireframe: bool = kept(False, "session")
    show_ground: bool = kept(True, "session")  # where there is one
    show_floor: bool = kept(False, "session")  # to look at, under what stands without a ground
    show_bones: bool = kept(True, "session")  # of a rig
    mesh_surface: str = kept("hidden", "session", good=one_of(SURFACES))  # over the picture
    mesh_opacity: float = kept(0.85, "session", good=share)
    # The strain, and the change of volume, at the end of the colors.
    mesh_range: float = kept(0.2, "session", good=number(*MESH_RANGES))
    photograph: str = "over"  # one of PHOTOGRAPHS
    photo_opacity: float = 0.5  # of one over the render
    brush_radius: float = 24.0  # points, of the brush that deletes
    show_box: bool = False  # that training found around the object
    show_photographed: bool = False  # marks what no photograph saw
    show_panel: bool = kept(True, "preferences")
    task: str = "bend"  # one of TASKS
    panel_side: str = kept("right", "preferences", good=one_of(SIDES))
    panel_width: float = kept(320.0, "preferences", good=number(*PANEL_WIDTHS))  # points
    theme: str = kept("dark", "preferences", good=one_of(THEMES))
    # Letters and buttons, over what the system says.
    panel_scale: float = kept(1.0, "preferences", good=number(*SCALES))
    show_help: bool = False
    has_chosen_keys: bool = kept(False, "preferences")  # until then a line offers them
    has_dragged: bool = kept(False, "preferences")  # a red point, ever; until then a line says how
    show_timeline: bool = kept(False, "project")
    handles_in_clips: bool = True
    panel_in_screenshots: bool = False
    transparent_screenshots: bool = False  # the field alone, its opacity as the PNG's alpha
    time_rendering: bool = False  # measure the renderer's own stages, which makes it slower


def kept_in(file: str) -> dict[str, Check]:
    """The checks of those of the Settings that a file keeps, by their names."""
    own = (one for one in fields(Settings) if file in one.metadata.get("files", ()))
    return {one.name: one.metadata["good"] for one in own}


SHOWN = tuple(kept_in("session"))


def shows_points(settings: Settings) -> bool:
    """Whether red points and pins show: not over the bones while a tool of bones is in the hand."""
    return settings.show_handles and settings.tool not in OF_BONES
