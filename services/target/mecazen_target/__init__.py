"""The walking person, and what the robot's sensor sees of them."""
