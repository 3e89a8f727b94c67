"""The pedestrians of Follow-Bench 1.0 (arXiv 2509.10796): planned ways, ORCA or social forces."""

STEP_S = 0.1
"""Time between two choices of the velocities [s]."""
SPEED_M_S = 1.5
"""Preferred speed."""
