from .train_job import TrainJob as TrainJob, TrainOffer as TrainOffer, offer_of as offer_of
from .watching import Watcher as Watcher
