from .core.model import Model as Model, load as load
from .core.render import (
    Camera as Camera,
    Image as Image,
    from_field_of_view as from_field_of_view,
    look_at as look_at,
)

# The program's version.
__version__: str
