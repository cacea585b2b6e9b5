"""From photographs to a field, and how good it is."""
