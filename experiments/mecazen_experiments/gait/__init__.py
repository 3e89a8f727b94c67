"""Gait: events and parameters of a walk, norms, files of gait laboratories, and a report."""
