"""The user's choices for picture, handles and files: plain data, without methods."""

from dataclasses import dataclass

DELETING = "delete", "delete box", "delete lasso"
OF_BONES = "joints", "bones"
ORBIT_KEYS = "alt", "ctrl", "shift"
TOOLS = "grab", "box", "lasso", "push", "stiffen", "soften", *DELETING, "isolate", *OF_BONES
SURFACES = "hidden", "plain", "strain", "volume ratio"  # of the coarse mesh
MESH_RANGES = 0.01, 1.0
SHOWN = (  # in films too
    *("mode", "background", "checkerboard", "show_handles", "show_wireframe"),
    *("show_ground", "show_floor", "show_bones", "mesh_surface", "mesh_opacity", "mesh_range"),
)
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
TARGET_FPS, CPU_TARGET_FPS = 60.0, 10.0


@dataclass
class Settings:
    """The choices that the panels show."""

    mode: str = "color"  # what the picture shows, one of core/render's MODES
    background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    checkerboard: bool = False  # behind the object instead of the background
    grab_radius: float = 0.08  # what a drag takes along, in object sizes
    grab_anywhere: bool = True  # not only at red points
    orbit_key: str = "alt"  # one of ORBIT_KEYS: with it a drag on the object orbits
    soft_grab: bool = False  # pull by springs, weaker towards the radius, not exactly
    hand: str = "physics"  # one of HANDS
    gizmo: str = "move"  # one of GIZMOS: what that of the selection does
    own_axes: bool = False  # the gizmo's are the selection's, not model space's
    keys: str = "deformrf"  # one of KEYS
    tool: str = "grab"  # what a left drag does, one of TOOLS
    fixed_resolution: float | None = None  # a factor; without it, what target_fps allows
    target_fps: float = TARGET_FPS
    accumulate: bool = True  # at rest, go on to the mean of shifted images
    show_handles: bool = True
    show_wireframe: bool = False
    show_ground: bool = True  # where there is one
    show_floor: bool = False  # to look at, under an object that stands where there is no ground
    show_bones: bool = True  # of a rig
    mesh_surface: str = "hidden"  # one of SURFACES, over the picture
    mesh_opacity: float = 0.85
    mesh_range: float = 0.2  # the strain, and the change of volume, at the end of the colors
    photograph: str = "over"  # one of PHOTOGRAPHS
    photo_opacity: float = 0.5  # of one over the render
    brush_radius: float = 24.0  # points, of the brush that deletes
    show_box: bool = False  # that training found around the object
    show_panel: bool = True
    task: str = "bend"  # one of TASKS
    panel_side: str = "right"  # one of SIDES
    panel_width: float = 320.0  # points
    theme: str = "dark"  # one of THEMES
    panel_scale: float = 1.0  # letters and buttons, over what the system says
    show_help: bool = False
    has_chosen_keys: bool = False  # until then a line offers them
    has_dragged: bool = False  # a red point, ever; until then a line says how
    show_timeline: bool = False
    handles_in_clips: bool = True
    panel_in_screenshots: bool = False
    transparent_screenshots: bool = False  # the field alone, its opacity as the PNG's alpha
    time_rendering: bool = False  # measure the renderer's own stages, which makes it slower
