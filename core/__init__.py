"""The method: geometry, field, rendering, dynamics, training, and modules that all of these use."""
