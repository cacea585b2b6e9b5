"""Rays to pixels: a field in its current pose as an image."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "render": ["Renderer"],
        "render_options": ["MODES", "Mode", "RenderOptions", "default_stop"],
        "rays.camera": [
            "Camera",
            "camera_rays",
            "from_field_of_view",
            "in_space",
            "look_at",
            "view_projection",
        ],
        "rays.lens": ["Lens", "distort", "has_rays", "pinhole"],
        "preview": ["preview", "seen_from_outside", "vertex_normals"],
        "modes": ["caption", "render_mode"],
        "subpixel": ["RunningMean", "shifted", "spread"],
        "visible": ["visible_part"],
        "kernels": ["kernel_modules"],
        # For training next door: kernels, their functions and structs.
        "rays": [
            "ANY_DEPTH",
            "COUNT",
            "DeviceCamera",
            "Entries",
            "Geometry",
            "Pose",
            "Rays",
            "Samples",
            "WRITE",
            "basis_kernel",
            "camera_ray",
            "device_camera",
            "empty_entries",
            "empty_rays",
            "empty_samples",
            "find_entries",
            "march_ray",
        ],
    },
)
