"""Frames and guidance as ROS 2 messages."""
