"""A training run: the field that learns, its optimization, workers and checkpoints."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "batch": ["Batch", "looks"],
        "checkpoint": [
            "Checkpoint",
            "CheckpointError",
            "is_checkpoint",
            "load_checkpoint",
            "save_checkpoint",
        ],
        "differentiable": ["on_warp_stream"],
        "distributed": ["ALONE", "Workers", "torchrun_workers", "was_worker"],
        "exposure": ["LearnedExposure"],
        "memory": ["ALLOCATION_ERRORS", "OutOfMemory", "give_memory_back", "lacks_memory"],
        "monitoring": ["Diverged", "History", "TrainingProgress"],
        "optimization": ["Optimization"],
        "surroundings": ["LearnedSurroundings", "over", "random_surroundings"],
        "training_field": ["TrainingField"],
    },
)
