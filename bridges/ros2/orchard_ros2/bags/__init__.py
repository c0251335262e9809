"""Bags of ROS 2: a recording as an MCAP file, with the messages of the bridge (package orchard_ros2)."""
