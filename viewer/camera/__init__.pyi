from .orbit import (
    CLOSEST as CLOSEST,
    CameraHistory as CameraHistory,
    FARTHEST as FARTHEST,
    Orbit as Orbit,
    camera_of as camera_of,
    changed as changed,
    clip_range as clip_range,
    facing as facing,
    framed as framed,
    looking_from as looking_from,
    panned as panned,
    turned as turned,
    turned_to as turned_to,
    values_of as values_of,
    widened as widened,
    with_up as with_up,
    zoomed as zoomed,
)
from .picking import (
    away_from_lines as away_from_lines,
    depth_at as depth_at,
    onto_view_plane as onto_view_plane,
    pick_sphere as pick_sphere,
    pixels_per_unit as pixels_per_unit,
    point_at as point_at,
    project as project,
    ray as ray,
    visible as visible,
    within as within,
)
from .framing import (
    Covered as Covered,
    film_frame as film_frame,
    in_free_part as in_free_part,
)
from .photographs import (
    Photograph as Photograph,
    Photographs as Photographs,
    Places as Places,
    is_seen_from as is_seen_from,
    places as places,
    seen_from as seen_from,
)
