from .export import (
    SurfaceMesh as SurfaceMesh,
    save_surface as save_surface,
    surface_of as surface_of,
    with_colors as with_colors,
)

# For the rest of the viewer.
from .opening import Opening as Opening
from .dialogs import (
    FileDialog as FileDialog,
    Problem as Problem,
    has_native_dialogs as has_native_dialogs,
    readable as readable,
)
