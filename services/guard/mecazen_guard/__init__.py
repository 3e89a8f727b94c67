"""Lets through what can still be stopped before anything that the lidar sees is touched."""
