"""Plans the robot's path round obstacles and people, without I/O."""
