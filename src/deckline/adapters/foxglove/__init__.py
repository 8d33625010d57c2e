"""ROS 2 messages into an MCAP file and to Foxglove."""
