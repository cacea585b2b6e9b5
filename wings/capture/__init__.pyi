from .cameras import Capture as Capture, find_cameras as find_cameras
from .photos import CaptureError as CaptureError
from .video import frames_of_video as frames_of_video

# For the commands and the viewer.
from .cameras import (
    doubts_about as doubts_about,
    is_capture as is_capture,
    names_masks as names_masks,
    summary as summary,
)
from .masking import program_words as program_words
from .page import THUMBNAIL as THUMBNAIL, Shown as Shown, judge as judge, page_of as page_of
from .photos import (
    IMAGE_SIZE as IMAGE_SIZE,
    find_photos as find_photos,
    read_photo as read_photo,
)
from .video import frames_folder as frames_folder, is_video as is_video
from .work import remove_left as remove_left
