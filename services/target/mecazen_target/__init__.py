"""The walking person, and the robot's sensor that observes them."""
