"""Manners: how people give way to others, step by step, and find their way.

`helbing` has the social force of Helbing & Molnár. `planned` has the pedestrians of Follow-Bench
1.0 (arXiv 2509.10796): a way by A*, ORCA or social forces on it, and a brake.
"""
