"""Everything that runs without a display: geometry, field, rendering, dynamics, training."""
