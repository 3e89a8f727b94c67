"""mecazen: messages, bus, time, configuration and command line of the simulator."""
