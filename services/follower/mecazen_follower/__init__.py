"""Estimators and control laws that keep the robot at its place beside the person."""
