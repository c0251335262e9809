"""Bags of ROS 2: a recording as an MCAP file, with the messages that the bridge to ROS 2 publishes (package orchard_ros2)."""
