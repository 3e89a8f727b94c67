"""Estimators and control laws that keep the robot at its goal pose beside the person."""
