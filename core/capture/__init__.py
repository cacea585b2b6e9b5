"""From photographs alone to their cameras and sparse points; see `find_cameras`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "cameras": [
            "Capture",
            "IMAGE_SIZE",
            "doubts_about",
            "find_cameras",
            "frames_of_video",
            "is_capture",
            "summary",
        ],
        "video": ["frames_folder", "is_video"],
        "page": ["THUMBNAIL", "Shown", "judge", "page_of"],
        "photos": ["CaptureError", "find_photos", "photo_files", "photo_folder", "read_photo"],
        "sharpness": ["exposure_of", "gray_of", "sharpness_of", "sharpness_weights"],
        "placing": ["focus", "upright"],
        "work": ["remove_left"],
        "points": ["POINTS_FILE", "SparsePoints", "load_points", "save_points"],
    },
)
