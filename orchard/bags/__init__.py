"""Bags of ROS 2: a recording as an MCAP file, with the messages of the bridge, and a replay of a
bag's velocities.
"""

from pathlib import Path

_here = Path(__file__).parent
if not (_here / "plain").is_dir():
    # In a clone, `orchard.bags.plain` is a folder of the bridge to ROS 2.
    __path__.append(str(_here.parents[1] / "bridges" / "ros2" / "orchard_ros2"))
