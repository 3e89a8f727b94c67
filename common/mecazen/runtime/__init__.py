"""The runtime: joins inputs, publishes outputs and keeps time, in one process or several."""
