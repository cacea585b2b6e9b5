"""Error of the solver against its run time."""
