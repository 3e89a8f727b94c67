"""Experiments: scenarios run many times, scored, and made into tables and figures."""
