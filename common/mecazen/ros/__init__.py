"""What ROS 2 needs to understand the messages: types, their hashes, and CDR. No ROS in it."""
