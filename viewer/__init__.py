"""The interactive viewer: the only place with a window."""
