"""Positions over time; knows nothing of radiance."""
