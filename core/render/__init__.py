"""Rays to pixels: a field in its current pose as an image."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "kernels": ["kernel_modules"],
        "modes": ["caption", "render_mode"],
        "render_options": ["MODES", "Mode", "RenderOptions"],
        "rays.camera": [
            "Camera",
            "DeviceCamera",
            "camera_ray",
            "camera_rays",
            "device_camera",
            "from_field_of_view",
            "in_space",
            "look_at",
            "view_projection",
        ],
        "rays.lens": ["Lens", "has_rays", "pinhole"],
        "rays.marching": [
            "COUNT",
            "WRITE",
            "basis_kernel",
            "empty_rays",
            "empty_samples",
            "march_kernel",
        ],
        "rays.pose": ["Pose"],
        "render": ["Renderer"],
        "rounds.compositing": ["composite_backward_kernel", "composite_kernel"],
        "subpixel": ["RunningMean", "shifted"],
        "visible": ["visible_part"],
    },
)
