"""Error against run time, stability, and what is left out; deformrf-report prints it."""
