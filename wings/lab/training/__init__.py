"""The error over training time."""
