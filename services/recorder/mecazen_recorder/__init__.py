"""The recorder: MCAP recordings of published samples, their replay and re-computation."""
