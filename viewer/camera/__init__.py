"""Where one looks from: the orbit camera, what lies at a pixel, photographs' cameras."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "orbit": [
            "CLOSEST",
            "FARTHEST",
            "Orbit",
            "camera_of",
            "changed",
            "clip_range",
            "facing",
            "framed",
            "panned",
            "pose_of",
            "turned",
            "turned_to",
            "values_of",
            "widened",
            "with_up",
            "zoomed",
        ],
        "picking": [
            "depth_at",
            "onto_view_plane",
            "pick_sphere",
            "pixels_per_unit",
            "point_at",
            "project",
            "ray",
            "visible",
            "within",
        ],
        "framing": ["Covered", "in_free_part"],
        "photographs": [
            "Photograph",
            "Photographs",
            "Places",
            "is_seen_from",
            "places",
            "seen_from",
        ],
    },
)
