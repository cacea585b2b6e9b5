"""Stress cases: what the solver and the renderer survive."""
