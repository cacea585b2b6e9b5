"""One ray: camera, lens, its walk through the mesh, and the pieces on it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "approach": [
            "ASIDE",
            "ball_around",
            "begin_at_ball",
            "is_far",
            "move_aside",
            "moved_aside",
        ],
        "camera": [
            "Camera",
            "DeviceCamera",
            "camera_ray",
            "camera_rays",
            "camera_rays_kernel",
            "device_camera",
        ],
        "cpu_march": ["lattice_paths", "march_some"],
        "entries": ["UNKNOWN", "Entries", "crossing_of", "empty_entries", "find_entries"],
        "marching": [
            "ANY_DEPTH",
            "COUNT",
            "FILL_SLOTS",
            "MIDDLE",
            "RaySamples",
            "Rays",
            "Samples",
            "WRITE",
            "basis_kernel",
            "empty_rays",
            "empty_samples",
            "march_kernel",
            "march_ray",
            "pack_kernel",
        ],
        "pose": ["Geometry", "Pose", "box_tree", "tet_frames_reference"],
        "raster": ["FaceRectangles", "raster_kernel"],
        "traversal": ["FADED", "interval_in_tet", "orientation", "speed_and_fade"],
    },
)
