"""Bags of ROS 2: makes one from a recording (`orchard export`), and lets the velocities in one
drive robots again (`orchard replay`).

A bag is a file of ROS messages with their times. The messages are made by `orchard.bags.plain`, the
same code as in the bridge to ROS 2.
"""

from pathlib import Path

_here = Path(__file__).parent
if not (_here / "plain").is_dir():
    # An installed package has its copy of `plain`, which setup.py makes. In a clone Python looks
    # for `orchard.bags.plain` in the folder of the bridge to ROS 2.
    __path__.append(str(_here.parents[1] / "bridges" / "ros2" / "orchard_ros2"))
