"""How the error fell with training time."""
