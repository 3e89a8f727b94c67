"""The command `mecazen`: starts, simulates, scores and watches; makes certificates."""

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""
