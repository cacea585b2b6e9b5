"""What a scene does not need, and what leaving it out saves."""
