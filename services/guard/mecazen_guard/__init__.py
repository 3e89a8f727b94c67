"""Limits commands so that the robot can stop before it touches anything that the lidar sees."""
