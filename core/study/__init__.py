"""Measured answers: error against run time, stability, what was left out."""
