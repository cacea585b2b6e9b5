"""What was done to a scene: edits are recorded on ticks, and can be undone."""
