"""A mecanum robot with every roller, in DART, and the owner of simulated time."""
