"""One JSON line per event of interest, for whoever drives the program from outside."""

import json

import numpy as np


class EventLog:
    """Prints events, or nothing at all."""

    def __init__(self, enabled: bool):
        self.enabled = enabled

    def __call__(self, event: str, **fields) -> None:
        if self.enabled:
            print(json.dumps({"event": event, **fields}, default=_plain), flush=True)


def _plain(value):
    """NumPy's arrays and numbers as JSON's."""
    if isinstance(value, np.ndarray):
        return value.astype(float).round(6).tolist()
    if isinstance(value, np.generic):
        return value.item()
    return str(value)
