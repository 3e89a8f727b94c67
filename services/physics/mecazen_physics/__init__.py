"""A mecanum robot with every roller, simulated in DART; this service owns simulated time."""
