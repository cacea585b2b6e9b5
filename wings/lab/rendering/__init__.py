"""Error of rendering against its run time."""
