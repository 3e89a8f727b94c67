"""The recorder: MCAP recordings of what is published, their replay and re-computation."""
