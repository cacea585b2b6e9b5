"""A training run: its stages, steps, batches and checkpoints."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "batch": ["Batch"],
        "checkpoint": ["Checkpoint", "load_checkpoint", "save_checkpoint"],
        "differentiable": ["on_warp_stream"],
        "distributed": ["ALONE", "Workers", "torchrun_workers"],
        "fit": ["Diverged", "Fit"],
        "history": ["History"],
        "progress": ["TrainingProgress"],
        "stage": ["Stage"],
        "surroundings": ["LearntSurroundings", "over", "random_surroundings"],
    },
)
