"""Photographs to a field: data sets, the two stages, evaluation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "data": [
            "Dataset",
            "DatasetError",
            "load_dataset",
            # for the commands and the lab
            "NoImagesError",
            "NoSplitError",
            "check_place",
            "check_some",
            "find_object",
            "focus",
            "has_cameras",
            "track",
            "white_composite",
            "world_to_unit_cube",
            # for the viewer
            "list_cameras",
            "list_images",
            "read_image",
            "shrunk_size",
            "size_of",
        ],
        "evaluation": [
            "evaluate",
            # for the commands and the lab
            "check_replaceable",
            "lacks_surroundings",
            "output_paths",
            "write_report",
        ],
        "train_options": ["TrainOptions", "preset"],
        "trainer": ["Pause", "Trained", "train"],
        # for the commands
        "lpips": ["LPIPS_SIZE_MIN", "Lpips"],
        "metrics": ["check_size"],
        "run": [
            "CheckpointError",
            "is_checkpoint",
            "load_checkpoint",
            "torchrun_workers",
            "was_worker",
        ],
    },
)
