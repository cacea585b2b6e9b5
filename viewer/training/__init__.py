"""deformrf-train, the model while it is trained (--view), and training that the viewer begins."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={"train_job": ["TrainJob", "TrainOffer", "begin_job", "follow_job", "offer_of"]},
)
