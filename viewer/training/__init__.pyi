from .train_job import (
    TrainJob as TrainJob,
    TrainOffer as TrainOffer,
    begin_job as begin_job,
    follow_job as follow_job,
    offer_of as offer_of,
)
