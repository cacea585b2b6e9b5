"""Damaged files of every layout that the program reads, and processes that watch over reading."""
