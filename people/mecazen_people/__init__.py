"""People: their paths, how they move, and their bodies."""
