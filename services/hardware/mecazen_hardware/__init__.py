"""Drivers of real robots, and an emulated board that is connected to mecazen's physics."""
