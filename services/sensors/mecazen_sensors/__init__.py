"""The robot's lidar, body tracker and depth camera, by rays in one scene."""
