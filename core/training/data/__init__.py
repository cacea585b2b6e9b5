"""Photographs and cameras, in the layouts that other programs write."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "cameras": ["list_cameras"],
        "datasets": [
            "Dataset",
            "check_some",
            "load_dataset",
            "read_image",
            "shrunk_size",
            "size_of",
            "track",
            "white_composite",
        ],
        "layouts": ["check_place", "has_cameras", "list_images"],
        "posed_images": ["DatasetError", "NoImagesError", "NoSplitError"],
        "raybank": ["EMPTY", "NO_LIMIT", "Drawn", "RayBank"],
        "found_object": ["FoundObject", "Plane", "find_object", "ground_of"],
        "scene_box": [
            "REACH",
            "are_photographs",
            "box_to_unit_cube",
            "found_to_unit_cube",
            "learns_surroundings",
            "object_box",
            "seeks_object",
            "world_to_unit_cube",
        ],
        "views": ["focus"],
    },
)
