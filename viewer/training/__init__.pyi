from .train_job import (
    TrainJob as TrainJob,
    TrainOffer as TrainOffer,
    begin_job as begin_job,
    follow_job as follow_job,
    offer_of as offer_of,
)

# For deformrf train --view.
from .live import POLL_SECONDS as POLL_SECONDS, LiveRun as LiveRun
from .live_window import LiveWindow as LiveWindow
