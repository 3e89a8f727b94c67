"""Identification of a robot's parameters from recordings with a reference pose."""
