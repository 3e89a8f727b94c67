"""All people: the followed person, the robot's sensor that observes them, and the crowd."""
