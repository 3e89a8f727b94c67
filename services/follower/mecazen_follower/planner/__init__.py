"""Plans the robot's way round obstacles and people: pure, numbers in, numbers out."""
