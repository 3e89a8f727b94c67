"""Shows a simulation in Rerun: read-only, and no part of the tick."""
