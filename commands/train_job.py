"""deformrf-train for the viewer: it prints a JSON line of how far it is now and then."""

import json
import time

from .training import prepare_training, train_command

TOLD_SECONDS = 0.5  # between two lines of how far it is


def main():
    """deformrf-train, which prints how far it is."""
    told = [0.0]

    def on_pause(pause):
        if time.monotonic() - told[0] >= TOLD_SECONDS:
            told[0] = time.monotonic()
            where = {"stage": pause.stage, "step": pause.step, "steps": pause.step_count}
            print(json.dumps(where), flush=True)

    train_command(lambda chosen: prepare_training(chosen, on_pause))
