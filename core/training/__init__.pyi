from .data.datasets import Dataset as Dataset, load_dataset as load_dataset
from .data.errors import (
    DatasetError as DatasetError,
    NoImagesError as NoImagesError,
    NoSplitError as NoSplitError,
)
from .data.cameras import list_cameras as list_cameras
from .train_options import TrainOptions as TrainOptions, preset as preset
from .trainer import Pause as Pause, Trained as Trained, train as train
from .run.checkpoint import CheckpointError as CheckpointError, load_checkpoint as load_checkpoint
from .evaluation import evaluate as evaluate
from .lpips import Lpips as Lpips

# For the commands and the lab.
from .train_options import LEAVE_OUT as LEAVE_OUT
from .data.layouts import check_place as check_place, has_cameras as has_cameras
from .data.datasets import (
    check_some as check_some,
    track as track,
    white_composite as white_composite,
)
from .data.found_object import find_object as find_object
from .data.sector import (
    SECTOR as SECTOR,
    Sector as Sector,
    find_sector as find_sector,
    name_of as name_of,
)
from .data.views import focus as focus
from .data.scene_box import (
    learns_surroundings as learns_surroundings,
    world_to_unit_cube as world_to_unit_cube,
)
from .evaluation import (
    check_replaceable as check_replaceable,
    lacks_surroundings as lacks_surroundings,
    output_paths as output_paths,
    scores_of as scores_of,
    write_report as write_report,
)
from .lpips import LPIPS_SIZE_MIN as LPIPS_SIZE_MIN
from .nearness import angles_told as angles_told
from .metrics import check_size as check_size
from .run.checkpoint import is_checkpoint as is_checkpoint
from .run.distributed import torchrun_workers as torchrun_workers, was_worker as was_worker

# For the viewer.
from .data.layouts import list_images as list_images
from .data.datasets import read_image as read_image, shrunk_size as shrunk_size, size_of as size_of

# For wings/capture.
from .data.transforms import MADE_BY as MADE_BY
from .data.masks import (
    UNTOLD as UNTOLD,
    mask_paths as mask_paths,
    read_mask as read_mask,
    without_classes as without_classes,
)
from .data.photo_files import (
    about_raw_files as about_raw_files,
    photo_files as photo_files,
    photo_folder as photo_folder,
)
from .data.points import (
    SparsePoints as SparsePoints,
    load_points as load_points,
    save_points as save_points,
)
from .data.posed_images import have_one_shape as have_one_shape
from .data.sharpness import (
    exposure_of as exposure_of,
    gray_of as gray_of,
    sharpness_of as sharpness_of,
    sharpness_weights as sharpness_weights,
)
from .data.views import (
    AROUND as AROUND,
    STEEP as STEEP,
    angles_to_nearest as angles_to_nearest,
    directions_from as directions_from,
    nearest_to_axes as nearest_to_axes,
    up_of as up_of,
    upright as upright,
    widest_step as widest_step,
)
