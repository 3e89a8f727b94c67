"""Speed and accuracy of the simulator: `mecazen bench`."""
