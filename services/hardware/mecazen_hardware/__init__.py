"""Drivers of real robots, and an emulator of a board in front of mecazen's physics."""
