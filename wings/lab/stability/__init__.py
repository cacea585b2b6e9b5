"""Stress cases for the solver and the renderer."""
