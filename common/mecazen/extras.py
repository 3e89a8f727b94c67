"""Extras of the distribution: which libraries they bring, and whether they are installed."""

from __future__ import annotations

import importlib.util

LIBRARIES = {
    "physics": "dartpy",
    "sensors": "mujoco",
    "follower": "filterpy",
    "hardware": "serial",
    "viewer": "rerun",
    "recorder": "mcap",
    "ros2": "rosbags",
    "studies": "joblib",
    "bench": "distributed",
}
"""A library of each extra, by extra; the extra of a service has the service's name."""


def is_installed(extra: str) -> bool:
    """Return whether an extra is installed; a service without one needs nothing more."""
    return extra not in LIBRARIES or importlib.util.find_spec(LIBRARIES[extra]) is not None
