"""A training run: the trained field, its optimization, workers and checkpoints."""
