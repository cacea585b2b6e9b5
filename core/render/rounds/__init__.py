"""Rounds of march, shade and composite until no ray is left."""
