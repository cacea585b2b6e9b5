"""The two networks: their definition, and one module for each place where they run."""
