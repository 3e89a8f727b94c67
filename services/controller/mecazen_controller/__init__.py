"""Wheel kinematics, odometry and limits of a mecanum robot."""
