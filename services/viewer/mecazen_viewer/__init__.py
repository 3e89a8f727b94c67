"""Shows a simulation in Rerun; an observer that no tick waits for."""
