"""Contact of a mesh with itself: find where it touches, and move the vertices there apart."""
