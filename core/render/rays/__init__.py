"""One ray: camera, lens, its walk through the mesh, and the pieces on it."""
