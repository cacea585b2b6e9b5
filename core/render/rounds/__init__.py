"""March, shade and composite until no ray is left: in rounds, or in one kernel (tracing.py)."""
