from .render import Image as Image, Renderer as Renderer, visible_field as visible_field
from .render_options import MODES as MODES, Mode as Mode, RenderOptions as RenderOptions
from .modes import caption as caption, render_mode as render_mode
from .rays.camera import (
    Camera as Camera,
    camera_rays as camera_rays,
    from_field_of_view as from_field_of_view,
    in_space as in_space,
    look_at as look_at,
    view_projection as view_projection,
)
from .rays.lens import Lens as Lens, distort as distort, has_rays as has_rays, pinhole as pinhole
from .preview import preview as preview

# For the rooms next door.
from .rays.views import rows_of_views as rows_of_views, views_of_rows as views_of_rows
from .render_options import default_stop as default_stop
from .preview import seen_from_outside as seen_from_outside, vertex_normals as vertex_normals
from .stage_timer import StageTimer as StageTimer
from .subpixel import RunningMean as RunningMean, shifted as shifted, spread as spread
from .temporal import PastView as PastView
from .upsampling import Upsampling as Upsampling
from .kernels import kernel_modules as kernel_modules

# For training next door: kernels, their functions and structs.
from .rays.marching import (
    COUNT as COUNT,
    Rays as Rays,
    RaySamples as RaySamples,
    WRITE as WRITE,
    basis_kernel as basis_kernel,
    empty_rays as empty_rays,
    empty_samples as empty_samples,
    march_ray as march_ray,
)
from .rays.camera import (
    DeviceCamera as DeviceCamera,
    camera_ray as camera_ray,
    device_camera as device_camera,
)
from .rays.entries import (
    empty_entries as empty_entries,
    find_entries as find_entries,
)
from .rays.pose import Geometry as Geometry, Pose as Pose
