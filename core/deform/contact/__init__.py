"""Contact of a mesh with itself: where parts of it touch, and what then moves their vertices."""
