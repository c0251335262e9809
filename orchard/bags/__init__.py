"""Bags of ROS 2: a recording as an MCAP file, with the messages of the bridge to ROS 2 (package orchard_ros2)."""
