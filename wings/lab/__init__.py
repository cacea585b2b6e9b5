"""Error against run time, stability, and omissions: the report of deformrf report."""
