"""Session files: what was done, written, checked, played again, and kept meanwhile."""
