"""Shows the nodes of mecazen to ROS 2, in the protocol of rmw_zenoh; reads and writes CDR."""
