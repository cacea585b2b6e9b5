"""A training run: the field that learns, its optimization, workers and checkpoints."""
