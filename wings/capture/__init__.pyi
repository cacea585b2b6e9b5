from .cameras import doubts_about as doubts_about
from .cameras import find_cameras as find_cameras
from .cameras import is_capture as is_capture
from .cameras import summary as summary
from .page import THUMBNAIL as THUMBNAIL, Shown as Shown, judge as judge, page_of as page_of
from .photos import CaptureError as CaptureError, IMAGE_SIZE as IMAGE_SIZE
from .photos import find_photos as find_photos
from .photos import read_photo as read_photo
from .video import (
    frames_folder as frames_folder,
    frames_of_video as frames_of_video,
    is_video as is_video,
)
from .work import remove_left as remove_left
