"""A training run: its stages, steps, batches and checkpoints."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "batch": ["Batch"],
        "checkpoint": ["Checkpoint"],
        "differentiable": ["on_warp_stream"],
        "distributed": ["ALONE", "Workers"],
        "fit": ["Diverged", "Fit"],
        "history": ["History"],
        "progress": ["TrainingProgress"],
        "stage": ["Stage"],
        "surroundings": ["LearntSurroundings", "over", "random_surroundings"],
    },
)
