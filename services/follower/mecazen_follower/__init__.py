"""Estimators and control that keep the robot with the person."""
