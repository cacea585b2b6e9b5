"""What is learnt: (tet, barycentric coordinates, direction) -> (sigma, rgb)."""
