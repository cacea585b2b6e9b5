"""The method and what carries it: geometry, field, rendering, dynamics, training."""
