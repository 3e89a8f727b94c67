"""The command `mecazen`: starts, simulates, scores and watches; makes certificates."""
