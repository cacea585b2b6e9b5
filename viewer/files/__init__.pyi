from .export import (
    SurfaceMesh as SurfaceMesh,
    save_surface as save_surface,
    surface_of as surface_of,
    with_colors as with_colors,
)

# For the rest of the viewer.
from .opening import (
    ask_for_file as ask_for_file,
    open_asked as open_asked,
    open_photographs as open_photographs,
    show_model as show_model,
)
from .dialogs import FileDialog as FileDialog, Problem as Problem, readable as readable
