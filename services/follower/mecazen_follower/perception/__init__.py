"""Perception: from sensor data to poses of persons."""
