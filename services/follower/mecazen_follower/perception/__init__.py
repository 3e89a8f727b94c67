"""Perception: from what sensors see to where persons are."""
