"""Rays to pixels."""
