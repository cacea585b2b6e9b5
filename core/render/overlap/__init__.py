"""Self-overlap of the mesh: find the rays that meet it, and render them."""
