"""Experiments: run scenarios many times, score them, and make tables and figures."""
