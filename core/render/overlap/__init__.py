"""Self-overlap of the mesh: finds the rays that meet it, and renders them."""
