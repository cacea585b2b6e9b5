"""The console commands, and what all commands share: exit codes, errors in one sentence."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "running": [
            "FAILED",
            "INPUT_ERROR",
            "INTERRUPTED",
            "asked_for_version",
            "complain",
            "interrupts_waiting",
            "require",
            "run",
        ],
        "train": ["TrainArguments", "prepare_training", "train_command"],
    },
)
