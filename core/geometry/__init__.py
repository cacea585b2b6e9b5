"""Tetrahedra: pure geometry, no learning, no time."""
