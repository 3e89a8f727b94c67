"""The robot's lidar, body tracker and depth camera, simulated by ray casts in one scene."""
