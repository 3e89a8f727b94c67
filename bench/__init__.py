"""How fast and how right the simulator is: `python -m bench`."""
