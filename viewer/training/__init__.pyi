from .train_job import TrainJob as TrainJob, TrainOffer as TrainOffer, offer_of as offer_of
from .watching import begin_job as begin_job, follow_job as follow_job, watch as watch
