"""Bones in the viewer: how they are made, posed and played, and how they move the object."""
