"""Poses, twists and places beside a person, drawn by hypothesis."""

import math

from hypothesis import strategies as st
from mecazen.geometry import Pose2D, Standoff, Twist2D

coordinates = st.floats(-100.0, 100.0)
angles = st.floats(-math.pi, math.pi)
poses = st.builds(Pose2D, coordinates, coordinates, angles)
twists = st.builds(Twist2D, *[st.floats(-5.0, 5.0)] * 3)
standoffs = st.builds(Standoff, st.floats(0.1, 10.0), angles, angles)
